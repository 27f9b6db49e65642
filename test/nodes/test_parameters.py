"""Settings as parameters of the real nodes: declared, validated, and the same in config/*.yaml."""

from pathlib import Path
import re

from node_process import node_class
import pytest
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import DescribeParameters, SetParametersAtomically
from rclpy.exceptions import ParameterException
from rclpy.parameter import Parameter
import yaml

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import parameters_of, range_of
from visual_servo_epipolar.nodes.startup.table import NODES, settings_of

CONFIG = Path(__file__).parents[2] / 'config'
# Where a file shall differ from the defaults: our own camera is reliable, a driver may not be; the
# simulation starts by itself, a robot must not.
MEANT_TO_DIFFER = {
    'servo_node': {'camera_reliability', 'autostart'},
    'route_node': {'law', 'max_linear', 'max_angular'},  # as fast as routes are
}


OF_RCLPY = {'use_sim_time', 'start_type_description_service'}


def settings_fields(name):
    return {item.name: item for kind in settings_of(name) for item in parameters_of(kind)}


def written(name, file=None):
    (section,) = yaml.safe_load((CONFIG / (file or f'{name}.yaml')).read_text()).values()
    return section['ros__parameters']


def plain(value):
    return list(value) if isinstance(value, tuple) else value


@pytest.fixture(params=NODES)
def running(request, bench, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the recorder begins a bag where it is started
    return request.param, bench, bench.start(node_class(request.param))


def test_every_setting_is_declared_with_text_range_and_whether_it_is_fixed(running) -> None:
    name, bench, node = running
    fields_by_name = settings_fields(name)
    assert node.get_parameters_by_prefix('').keys() - OF_RCLPY == fields_by_name.keys()
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
def test_a_file_has_every_parameter_in_order_with_its_type_and_default(name) -> None:
    defaults = {key: plain(item.default) for key, item in settings_fields(name).items()}
    values = written(name)
    assert list(values) == list(defaults)
    assert [type(value) for value in values.values()] == [type(it) for it in defaults.values()]
    differing = {key for key, value in values.items() if value != defaults[key]}
    assert differing == MEANT_TO_DIFFER.get(name, set())


def test_the_small_camera_is_the_large_one_with_pixels_binned() -> None:
    small, large = written('camera_node', 'camera_node_640x480.yaml'), written('camera_node')
    assert list(small) == [key for key in large if key in small]
    assert small['focal_length'] == large['focal_length'] / 2
    # Pixel centres: u of two binned pixels is half of (u1 + u2), 16 rows are cut on either side.
    assert small['principal_u'] == (large['principal_u'] - 0.5) / 2
    assert small['principal_v'] == (large['principal_v'] - 0.5) / 2 - 16
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
    ('servo_node', 'law', 'full-retreat', "got 'full-retreat'; a departure is left out by its se"),
    ('camera_node', 'frame_rate', 30.0, 'read-only'),
]


@pytest.mark.parametrize(('name', 'key', 'value', 'reason'), BAD)
def test_a_change_that_cannot_be_is_refused_with_a_reason(bench, name, key, value, reason) -> None:
    node = bench.start(node_class(name))
    before = node.get_parameters_by_prefix('')
    result = change(bench, name, **{key: value})
    assert not result.successful
    assert re.search(reason, result.reason), result.reason
    assert {key: it.value for key, it in node.get_parameters_by_prefix('').items()} == {
        key: it.value for key, it in before.items()
    }


def test_changes_are_taken_together_or_not_at_all_and_logged_with_what_was(bench) -> None:
    servo = bench.start(node_class('servo_node'))
    assert not change(bench, 'servo_node', latency=0.2, dead_band_linear=0.9).successful
    assert servo.get_parameter('latency').value == ServoSettings().latency
    result = change(bench, 'servo_node', dead_band_linear=0.5, max_linear=0.6)
    assert result.successful, result.reason
    names = 'dead_band_linear', 'max_linear'
    assert [servo.get_parameter(name).value for name in names] == [0.5, 0.6]
    bench.until(lambda: bench.logged('max_linear: 0.4 -> 0.6'), 'the change in the log')


REFUSED = [
    ('recorder_node', {'topics': ('',)}, "topics must name what to record, got .*; '\\*' is all"),
    (
        'recorder_node',
        {'topics': ('a b',)},
        "topics and exclude must be names or patterns, got 'a b'",
    ),
    ('servo_node', {'latency': 1}, "'INTEGER', expecting type 'DOUBLE'"),
    ('servo_node', {'latency': 99.0}, 'out of range'),
    ('servo_node', {'latch_engage': 0.1}, 'latch_engage must not exceed latch_release'),
    (
        'servo_node',
        {'room': 0.5, 'least_room': 0.1},
        'rename or delete them in your file:\n  room -> spiral_ratio\n  least_room -> least',
    ),
    ('servo_node', {'ackermann': True}, 'ackermann -> base: car'),
    ('servo_node', {'pan_joint': ''}, 'pan_joint must be the name of a joint other than'),
    ('camera_node', {'pan_joint': 'a', 'tilt_joint': 'a'}, 'must be the name of a joint other'),
    (
        'tracker_node',
        {'auxiliary_features': 9},
        '^tracker_node .*\n  auxiliary_features: gone, 0 holds$',
    ),
]


@pytest.mark.parametrize(('name', 'values', 'reason'), REFUSED)
def test_what_cannot_be_is_refused_at_the_start(bench, name, values, reason) -> None:
    with pytest.raises((ValueError, ParameterException, InputError), match=reason):
        bench.start(node_class(name), **values)


@pytest.mark.parametrize(
    ('name', 'values'),
    [('servo_node', {'ackermann': False}), ('tracker_node', {'auxiliary_features': 0})],
)
def test_a_parameter_that_is_gone_may_have_the_value_that_holds(bench, name, values) -> None:
    bench.start(node_class(name), **values)  # as files of earlier versions have it


def test_a_list_that_is_given_may_be_empty(bench) -> None:
    node = bench.start(node_class('recorder_node'), exclude=(), autostart=False)
    assert not node.get_parameter_or('exclude').value
