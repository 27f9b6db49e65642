"""Settings as parameters of the real nodes: declared, validated, and the same in config/*.yaml."""

from pathlib import Path
import re

import pytest
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, SetParametersAtomically
from rclpy.exceptions import ParameterException
from rclpy.parameter import Parameter
import yaml

from visual_servo_epipolar.bags.recording.settings import RecordSettings
from visual_servo_epipolar.core.docking.pose import DockPoseSettings
from visual_servo_epipolar.core.docking.task import DockTaskSettings
from visual_servo_epipolar.core.routes.settings import FollowSettings, TeachSettings
from visual_servo_epipolar.core.servo.settings import ServoSettings, StationSettings
from visual_servo_epipolar.core.settings import parameters_of, range_of
from visual_servo_epipolar.core.tracking.tracker import TrackerSettings
from visual_servo_epipolar.nodes.camera_node import (
    CameraNode,
    CameraRig,
    HeadSettings,
)
from visual_servo_epipolar.nodes.dock_node import DockNode, DockNodeSettings
from visual_servo_epipolar.nodes.recorder_node import RecorderNode
from visual_servo_epipolar.nodes.route_node import RouteNode
from visual_servo_epipolar.nodes.servo_node import ServoNode, ServoNodeSettings
from visual_servo_epipolar.nodes.startup.settings import RecorderNodeSettings, RouteNodeSettings
from visual_servo_epipolar.nodes.tracker_node import TrackerNode, TrackerNodeSettings
from visual_servo_epipolar.nodes.unicycle_node import UnicycleNode, UnicycleSettings
from visual_servo_epipolar.simulation.bases import AckermannSettings
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.disturbances import DisturbanceSettings
from visual_servo_epipolar.simulation.light import LightSettings

CONFIG = Path(__file__).parents[2] / 'config'
NODES = {
    'unicycle_node': (UnicycleNode, (UnicycleSettings, AckermannSettings)),
    'camera_node': (
        CameraNode,
        (
            CameraSettings,
            HeadSettings,
            CameraRig,
            DisturbanceSettings,
            LightSettings,
        ),
    ),
    'tracker_node': (TrackerNode, (TrackerNodeSettings, TrackerSettings)),
    'servo_node': (ServoNode, (ServoNodeSettings, ServoSettings)),
    'recorder_node': (RecorderNode, (RecorderNodeSettings, RecordSettings)),
    'dock_node': (DockNode, (DockNodeSettings, DockTaskSettings, DockPoseSettings)),
    'route_node': (RouteNode, (RouteNodeSettings, StationSettings, FollowSettings, TeachSettings)),
}
# Where a file shall differ from the defaults: our own camera is reliable, a driver may not be; the
# simulation starts by itself, a robot must not.
MEANT_TO_DIFFER = {
    'servo_node': {'camera_reliability', 'autostart'},
    'route_node': {'law', 'max_linear', 'max_angular'},  # as fast as routes are
}


def settings_fields(name):
    return {item.name: item for kind in NODES[name][1] for item in parameters_of(kind)}


def written(name, file=None):
    (section,) = yaml.safe_load((CONFIG / (file or f'{name}.yaml')).read_text()).values()
    return section['ros__parameters']


def plain(value):
    return list(value) if isinstance(value, tuple) else value


@pytest.fixture(params=NODES)
def running(request, bench, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the recorder begins a bag where it is started
    return request.param, bench, bench.start(NODES[request.param][0])


def test_every_setting_is_declared_with_text_range_and_whether_it_is_fixed(running) -> None:
    name, bench, _ = running
    fields_by_name = settings_fields(name)
    request = DescribeParameters.Request(names=list(fields_by_name))
    answer = bench.call(f'{name}/describe_parameters', DescribeParameters, request)
    descriptors = answer.descriptors
    for descriptor, item in zip(descriptors, fields_by_name.values(), strict=True):
        limits = range_of(item)
        assert descriptor.type != ParameterType.PARAMETER_NOT_SET
        assert limits.text and descriptor.description.startswith(limits.text), item.name
        assert all(choice in descriptor.description for choice in limits.choices)
        assert descriptor.read_only is limits.read_only, item.name
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        expected = [] if limits.low is None else [(limits.low, limits.high)]
        assert [(r.from_value, r.to_value) for r in ranges] == expected, item.name


def test_every_number_has_a_range() -> None:
    for name in NODES:
        for item in settings_fields(name).values():
            if type(item.default) in (int, float):
                limits = range_of(item)
                assert limits.low is not None and limits.high is not None, item.name


@pytest.mark.parametrize('name', NODES)
def test_the_configuration_file_names_every_parameter_in_order(name) -> None:
    assert list(written(name)) == list(settings_fields(name))


@pytest.mark.parametrize('name', NODES)
def test_the_configuration_file_holds_the_defaults(name) -> None:
    defaults = {key: plain(item.default) for key, item in settings_fields(name).items()}
    differing = {key for key, value in written(name).items() if value != defaults[key]}
    assert differing == MEANT_TO_DIFFER.get(name, set())


@pytest.mark.parametrize('name', NODES)
def test_the_configuration_file_has_the_types_that_ros_insists_on(name) -> None:
    for key, value in written(name).items():
        assert type(value) is type(plain(settings_fields(name)[key].default)), key


def test_the_small_camera_is_the_large_one_with_pixels_binned() -> None:
    small, large = written('camera_node', 'camera_node_640x480.yaml'), written('camera_node')
    assert list(small) == [key for key in large if key in small]
    assert small['focal_length'] == large['focal_length'] / 2
    # Pixel centres: u of two binned pixels is half of (u1 + u2), 16 rows are cut on either side.
    assert small['principal_u'] == (large['principal_u'] - 0.5) / 2
    assert small['principal_v'] == (large['principal_v'] - 0.5) / 2 - 16


def test_the_small_scenario_is_the_small_camera() -> None:
    small = written('camera_node', 'camera_node_640x480.yaml')
    assert yaml.safe_load((CONFIG / 'scenarios/small.yaml').read_text())['camera'] == small


def change(bench, node, **values):
    """Set parameters of a node as one; return what it says."""
    parameters = [
        Parameter(name, value=value).to_parameter_msg() for name, value in values.items()
    ]
    request = SetParametersAtomically.Request(parameters=parameters)
    return bench.call(f'{node}/set_parameters_atomically', SetParametersAtomically, request).result


BAD = [
    ('servo_node', 'latency', 99.0, 'latency out of range'),
    ('servo_node', 'latency', float('nan'), 'latency'),
    ('servo_node', 'latency', 1, 'DOUBLE.* got .*INTEGER'),
    ('tracker_node', 'max_features', 2.0, 'INTEGER.* got .*DOUBLE'),
    ('unicycle_node', 'start', [1, 2, 3], 'DOUBLE_ARRAY.* got .*INTEGER_ARRAY'),
    ('tracker_node', 'max_features', 0, 'max_features out of range'),
    ('servo_node', 'law', 'other', 'one of paper, corrected, full'),
    ('servo_node', 'estimator', 'lmeds_8pt', 'read-only'),
    ('servo_node', 'dead_band_linear', 0.9, 'must not exceed max_linear'),
    ('servo_node', 'gain', 0.1, 'no parameter gain; did you mean gains'),
    ('tracker_node', 'min_features', 61, 'must not exceed max_features'),
    ('unicycle_node', 'max_linear', -1.0, 'max_linear out of range'),
    ('unicycle_node', 'start', [1.0, 2.0], 'start must be three numbers'),
    ('camera_node', 'frame_rate', 30.0, 'read-only'),
]


@pytest.mark.parametrize(('name', 'key', 'value', 'reason'), BAD)
def test_a_change_that_cannot_be_is_refused_with_a_reason(bench, name, key, value, reason) -> None:
    node = bench.start(NODES[name][0])
    result = change(bench, name, **{key: value})
    assert not result.successful
    assert re.search(reason, result.reason), result.reason
    assert not node.has_parameter('gain')


def test_a_refused_change_changes_nothing(bench) -> None:
    servo = bench.start(ServoNode)
    change(bench, 'servo_node', latency=0.2, dead_band_linear=0.9)
    assert servo.get_parameter('latency').value == ServoSettings().latency


def test_a_change_is_logged_with_what_it_was(bench) -> None:
    bench.start(ServoNode)
    assert change(bench, 'servo_node', max_linear=0.1).successful
    bench.until(lambda: bench.logged('max_linear: 0.4 -> 0.1'), 'the change in the log')


def test_two_changes_that_need_each_other_are_taken_together(bench) -> None:
    servo = bench.start(ServoNode)
    result = change(bench, 'servo_node', dead_band_linear=0.5, max_linear=0.6)
    assert result.successful, result.reason
    names = 'dead_band_linear', 'max_linear'
    assert [servo.get_parameter(name).value for name in names] == [0.5, 0.6]


GOOD = [
    ('servo_node', 'latency', 0.5, lambda node: node._settings.latency),
    ('servo_node', 'law', 'paper', lambda node: node._settings.law),
    ('tracker_node', 'max_features', 50, lambda node: node._tracker.settings.max_features),
    ('unicycle_node', 'max_linear', 0.25, lambda node: node._base.settings.max_linear),
    ('camera_node', 'jitter', 0.05, lambda node: node._simulator.settings.jitter),
    ('camera_node', 'exposure', 'auto', lambda node: node._simulator.light.exposure),
]


@pytest.mark.parametrize(('name', 'key', 'value', 'current'), GOOD)
def test_a_good_change_reaches_what_it_is_for(bench, name, key, value, current) -> None:
    node = bench.start(NODES[name][0])
    assert current(node) != value
    result = change(bench, name, **{key: value})
    assert result.successful, result.reason
    assert current(node) == value


def test_an_expression_with_a_departure_is_refused_and_its_setting_named(bench) -> None:
    servo = bench.start(ServoNode, law='full')
    result = change(bench, 'servo_node', law='full-retreat')
    assert not result.successful
    assert "got 'full-retreat'; a departure is left out by its setting" in result.reason
    assert servo.get_parameter('law').value == 'full'


def test_a_misspelt_parameter_is_refused_at_the_start_with_a_suggestion(bench) -> None:
    with pytest.raises(ValueError, match='no parameter max_linaer; did you mean max_linear'):
        bench.start(UnicycleNode, max_linaer=0.3)


def test_a_parameter_from_elsewhere_is_refused_with_all_that_there_are(bench) -> None:
    with pytest.raises(ValueError, match='no parameter zzz; it knows '):
        bench.start(UnicycleNode, zzz=1.0)


@pytest.mark.parametrize(
    ('value', 'reason'), [(1, "'INTEGER', expecting type 'DOUBLE'"), (99.0, 'out of range')]
)
def test_a_bad_value_is_refused_at_the_start(bench, value, reason) -> None:
    with pytest.raises(ParameterException, match=reason):
        bench.start(ServoNode, latency=value)


def test_settings_that_contradict_each_other_are_refused_at_the_start(bench) -> None:
    with pytest.raises(ValueError, match='latch_engage must not exceed latch_release'):
        bench.start(ServoNode, latch_engage=0.1)


def test_names_of_earlier_versions_are_answered_all_at_once_each_in_a_line(bench) -> None:
    expected = 'rename or delete them in your file:\n  room -> spiral_ratio\n  least_room -> least'
    with pytest.raises(ValueError, match=expected):
        bench.start(ServoNode, room=0.5, least_room=0.1)


def test_a_parameter_that_is_gone_is_answered_with_what_holds(bench) -> None:
    with pytest.raises(ValueError, match='^tracker_node .*\n  auxiliary_features: gone, 0 holds$'):
        bench.start(TrackerNode, auxiliary_features=9)
    bench.start(TrackerNode, auxiliary_features=0)


def test_a_list_that_is_given_may_be_empty(bench) -> None:
    node = bench.start(RecorderNode, exclude=(), autostart=False)
    assert not node.get_parameter_or('exclude').value
