"""Nodes in lockstep: they arrive, are the loop in memory to the last digit, and recorded whole."""

from collections import Counter
from dataclasses import dataclass, replace
from functools import partial
import os
from pathlib import Path

from bag_reading import read_back
from durations import few_of
import pytest
from rclpy.publisher import Publisher
from rosbags.highlevel import AnyReader
from small_cameras import SMALL

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.run_log import RunLog, summarise
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.nodes import lockstep
from visual_servo_epipolar.nodes.commands import Commands
from visual_servo_epipolar.nodes.lockstep import Lockstep, LockstepError, ObserverNode
from visual_servo_epipolar.simulation import closed_loop
from visual_servo_epipolar.simulation.closed_loop import LoopSettings, RunMonitor
from visual_servo_epipolar.simulation.disturbances import DisturbanceSettings
from visual_servo_epipolar.simulation.scenario import from_document, load, Scenario
from visual_servo_epipolar.simulation.views import view_of

CONFIG = Path(__file__).parents[2] / 'config'
CLOSE_BY = from_document({'camera': SMALL}, 'tiny').seeded(3)
CLOSE = (0.3, -2.2, 0.0)


def drive(scenario: Scenario, settings: LoopSettings, folder: Path | None = None) -> RunLog:
    """Let the nodes drive, and record it to ``folder``, if that is given."""
    monitor = RunMonitor(settings)
    with Lockstep(scenario, settings) as nodes:
        nodes.add(ObserverNode(monitor, lambda *_: None, with_images=False, context=nodes.context))
        if folder is not None:
            nodes.record(folder)
        nodes.run(lambda: monitor.done)
    return monitor.log()


def simulate(scenario: Scenario, settings: LoopSettings) -> RunLog:
    """Let the loop in memory drive."""
    view = view_of(scenario, 'images', settings.seed)
    return closed_loop.Loop(settings, view, scenario.camera.nominal_camera).run()


def short(**camera: object) -> Scenario:
    """Return a run of one second through a very small camera."""
    return from_document({'camera': {**SMALL, **camera}, 'run': {'max_duration': 1.0}}, 'short')


def test_the_nodes_drive_exactly_as_the_loop_in_memory_and_arrive() -> None:
    settings = CLOSE_BY.loop(CLOSE, 3)
    arrival, expected = drive(CLOSE_BY, settings), simulate(CLOSE_BY, settings)
    assert repr(arrival.samples) == repr(expected.samples)  # for nan is not equal to itself
    result = summarise(arrival)
    assert repr(result) == repr(summarise(expected))
    assert result['outcome'] == 'arrived', result['reason']
    assert result['position_error_m'] < 0.02
    assert abs(result['heading_error_deg']) < 0.5


def disturbed() -> tuple[Scenario, LoopSettings]:
    """Return a run with passers-by and a camera that is miscalibrated."""
    camera = {'believed_focal_ratio': 0.8, 'believed_shift_u': 7.0, 'mount_left': 0.1}
    passing = DisturbanceSettings(disturbed_from=3, disturbed_for=5, occlusion=0.4, light_step=0.2)
    scenario = replace(short(**camera), disturbances=passing).seeded(2)
    return scenario, scenario.loop(CLOSE, 2)


def with_head() -> tuple[Scenario, LoopSettings]:
    """Return a run with a head that turns."""
    scenario = short(rig='pan_tilt', mount_yaw=0.02)
    scenario = scenario.with_servo({'rig': 'pan_tilt', 'law': 'smooth'}).seeded(2)
    return scenario, replace(scenario.loop((1.5, -2.0, 30.0), 2), max_duration=2.0)


def by_wheels() -> tuple[Scenario, LoopSettings]:
    """Return a run by odometry."""
    scenario = short(jitter=0.002).with_servo({'odometry': True}).seeded(3)
    return scenario, replace(scenario.loop(CLOSE, 3), max_duration=3.0)


def of_rig(rig: str) -> tuple[Scenario, LoopSettings]:
    """Return a run of a rig through a camera with fewer pixels."""
    scenario = load(None, CONFIG / f'rigs/{rig}.yaml')
    ratio = 320 / scenario.camera.height
    tiny = replace(
        scenario.camera,
        width=round(ratio * scenario.camera.width),
        height=320,
        focal_length=ratio * scenario.camera.focal_length,
        principal_u=ratio * (scenario.camera.principal_u + 0.5) - 0.5,
        principal_v=ratio * (scenario.camera.principal_v + 0.5) - 0.5,
    )
    scenario = replace(scenario, camera=tiny).seeded(4)
    return scenario, replace(scenario.loop((0.5, -2.2, 8.0), 4), max_duration=2.5)


@pytest.mark.parametrize(
    'made',
    [
        *(disturbed, with_head, by_wheels),
        *few_of([partial(of_rig, 'car'), partial(of_rig, 'panorama_small')]),
    ],
)
def test_nodes_of_any_kind_drive_exactly_as_the_loop_in_memory(made) -> None:
    scenario, settings = made()
    log = drive(scenario, settings)
    assert repr(log) == repr(simulate(scenario, settings))
    assert any(sample.twist != STANDSTILL for sample in log.samples)


def test_a_camera_without_distortion_coefficients_runs() -> None:
    scenario = short(distortion=[])
    assert len(drive(scenario, scenario.loop(CLOSE, 0)).samples) >= 10


def test_a_chain_that_stands_still_is_reported(monkeypatch) -> None:
    scenario = short()
    with Lockstep(scenario, scenario.loop(CLOSE, 0)) as nodes:
        begin = nodes.unicycle.begin  # until then nodes may take their time

        def begin_impatiently() -> None:
            monkeypatch.setattr(lockstep, 'STALL_S', 0.5)
            begin()

        nodes.unicycle.begin = begin_impatiently
        monkeypatch.setattr(Commands, 'send', lambda *_: None)
        with pytest.raises(LockstepError, match=r'after 0 steps, waiting for the first step'):
            nodes.run(lambda: False)


def test_nodes_that_do_not_find_each_other_are_reported(monkeypatch) -> None:
    monkeypatch.setattr(lockstep, 'STALL_S', 0.5)
    scenario = short()
    with Lockstep(scenario, scenario.loop(CLOSE, 0)) as nodes:
        heard = nodes.tracker.subscriptions
        photograph = next(item for item in heard if 'desired' in item.topic_name)
        nodes.tracker.destroy_subscription(photograph)
        with pytest.raises(LockstepError, match='every node to find its peers and the photograph'):
            nodes.run(lambda: False)


def test_the_environment_is_left_as_it_was_also_by_a_node_that_cannot_be(monkeypatch) -> None:
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    scenario = short()
    with Lockstep(scenario, scenario.loop(CLOSE, 0)):
        assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'OFF'
    assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
    with pytest.raises(ValueError, match='start must be three numbers'):
        Lockstep(scenario, replace(scenario.loop(CLOSE, 0), start=(1.0, 2.0)))
    assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'


def drive_a_second(folder: Path | None = None) -> RunLog:
    scenario = short(jitter=0.002).seeded(1)
    return drive(scenario, scenario.loop(CLOSE, 1), folder)


@dataclass(frozen=True)
class Run:
    """A run that was recorded, and how many messages were published on each topic."""

    bag: Path
    log: RunLog
    published: Counter[str]


@pytest.fixture(scope='module')
def recorded(tmp_path_factory) -> Run:
    counts: Counter[str] = Counter()
    publish = Publisher.publish

    def counted(self, message) -> None:
        counts[self.topic_name] += 1
        publish(self, message)

    bag = tmp_path_factory.mktemp('lockstep') / 'bag'
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Publisher, 'publish', counted)
        return Run(bag, drive_a_second(bag), counts)


def test_every_message_of_every_topic_is_recorded(recorded) -> None:
    # The servo says why it stands when it is activated, before the recorder is there.
    expected = recorded.published - Counter({'/parameter_events': 10**6, '/diagnostics': 1})
    assert expected['/image_raw'] > 10
    assert Counter(topic for topic, _, _ in read_back(recorded.bag)) == expected


def test_two_runs_make_the_same_bag(recorded, tmp_path) -> None:
    drive_a_second(tmp_path / 'bag')
    # Which of two topics comes first at the same time is left to the executor.
    assert sorted(read_back(tmp_path / 'bag')) == sorted(read_back(recorded.bag))


def test_the_run_is_what_it_is_without_a_recorder(recorded) -> None:
    assert repr(recorded.log) == repr(drive_a_second())
    assert any(sample.phase is not Phase.WAITING for sample in recorded.log.samples)


def test_rosbags_decodes_every_message_and_stamps_agree(recorded) -> None:
    with AnyReader([recorded.bag]) as reader:
        for connection, stamp_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            if connection.topic in ('/image_raw', '/tracks', '/epipoles', '/ground_truth'):
                assert read.stamp_ns(message.header) == stamp_ns, connection.topic
