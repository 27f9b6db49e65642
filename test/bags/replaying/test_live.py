"""A run that is interrupted as on a robot: orders, silence, new gains; its replay is the same."""

from pathlib import Path

from bagmaker import decoded, Message, new_listener, write_bag
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import String
from std_srvs.srv import Trigger

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.run import Happening, happenings, read_run
from visual_servo_epipolar.bags.reading.topics import assign_roles
from visual_servo_epipolar.bags.replaying.comparison import compare, Comparison
from visual_servo_epipolar.bags.replaying.plan import plan, ReplayOverrides
from visual_servo_epipolar.bags.replaying.replay import replay, ReplayedStep
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.laws.standing import RESUMING_FRAMES
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import driving_inputs, qos
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.nodes.tracker_node import TrackerNode
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld
from visual_servo_epipolar.simulation.rigs import FixedRig

DRIVING = {'autostart': True, 'stale_timeout': 60.0, 'max_latency': 0.0}


class Robot:
    """Servo, tracker or both in wall time, fed with the messages of a run one by one."""

    def __init__(self, bench, run: list[Message], topic: str, *kinds: object) -> None:
        self.bench = bench
        listener, self.received = new_listener(bench.context)
        bench.add(listener)
        self.talk = bench.talk({'/tracks': PointCloud2, '/image_raw': Image}[topic], topic)
        self.calibrate = bench.talk(CameraInfo, '/camera_info')
        self.nodes = [
            bench.start(kind, **values)
            for kind, values in zip(kinds[::2], kinds[1::2], strict=True)
        ]
        self.messages = [item[2] for item in run if item[0] == topic]
        self.calibrate(next(item[2] for item in run if item[0] == '/camera_info'))
        bench.settle()

    def see(self, first: int, end: int) -> None:
        for raw in self.messages[first:end]:
            self.talk(raw)
            self.bench.settle()

    def call(self, service: str) -> None:
        assert self.bench.call(service, Trigger).success
        self.bench.settle()


def replayed(path, **overrides: object) -> tuple[list[ReplayedStep], Comparison]:
    with Bag(path) as bag:
        run = read_run(bag, assign_roles(bag, {}))
        steps = replay(bag, run, plan(bag, run, ReplayOverrides(**overrides))[0])
    return steps, compare(run, steps, 0.0)


def told(path) -> list[Happening]:
    """Return what the bag tells of orders and settings."""
    with Bag(path) as bag:
        run = read_run(bag, assign_roles(bag, {}))
        return happenings(run, min(run.telemetry)[0])


@pytest.fixture
def servo(bench, small_run) -> Robot:
    return Robot(bench, small_run, '/tracks', ServoNode, DRIVING)


def test_stop_start_and_reset_are_replayed_where_they_happened(servo, tmp_path) -> None:
    servo.see(0, 5)
    servo.call('servo_node/stop')
    servo.see(5, 7)  # heard, not acted on
    servo.call('servo_node/start')
    servo.see(7, 12)
    servo.call('servo_node/reset')
    servo.see(12, 16)
    servo.nodes[0].set_parameters([Parameter('max_speed_ratio', value=0.5)])
    servo.see(16, 20)
    steps, comparison = replayed(write_bag(tmp_path / 'orders', servo.received))
    assert len(steps) == 18
    assert comparison.equal, comparison.divergence
    history = told(tmp_path / 'orders')
    assert [item.what.partition(',')[0] for item in history] == [
        'stopped',
        'started',
        'brought to a standstill',
        'reset to a new run',
        'max_speed_ratio set from 1.0 to 0.5',
    ]
    assert {item.node for item in history} == {'servo'}
    times = [item.time_s for item in history]
    assert times == pytest.approx([4 / 11, 6 / 11, 1.0, 1.0, 15 / 11], abs=1e-6)
    remaining = [item for item in servo.received if item[0] != '/servo_node/events']
    assert not replayed(write_bag(tmp_path / 'untold', remaining))[1].equal


def test_silence_is_replayed_where_it_fell(bench, small_run, tmp_path) -> None:
    servo = Robot(bench, small_run, '/tracks', ServoNode, DRIVING)
    phases = bench.listen(String, 'phase', qos.LATCHED)
    servo.see(0, 5)
    servo.nodes[0].set_parameters([Parameter('stale_timeout', value=0.05)])
    bench.until(lambda: phases[-1].data == 'holding', 'the watchdog')
    servo.nodes[0].set_parameters([Parameter('stale_timeout', value=60.0)])
    servo.see(5, 12)
    events = [decoded(item).data for item in servo.received if item[0] == '/servo_node/events']
    assert any('"lost"' in text and 'no new tracks for' in text for text in events)
    steps, comparison = replayed(write_bag(tmp_path / 'silence', servo.received))
    assert len(steps) == 12
    assert comparison.equal, comparison.divergence


def test_a_photograph_on_the_way_and_redetection_are_replayed(bench, small_run, tmp_path) -> None:
    robot = Robot(
        bench,
        small_run,
        '/image_raw',
        TrackerNode,
        {'camera_reliability': 'reliable'},
        ServoNode,
        {**DRIVING, 'camera_reliability': 'reliable'},
    )
    robot.calibrate(next(item[2] for item in small_run if item[0] == '/camera_info'))
    bench.settle()
    robot.see(40, 41)  # nothing to come back to yet; one image: the next would be of another view
    robot.call('tracker_node/capture_desired')
    robot.see(41, 46)
    robot.call('tracker_node/redetect')
    robot.see(46, 50)
    path = write_bag(tmp_path / 'taught', robot.received)
    steps, comparison = replayed(path)
    assert len(steps) == 10
    assert [step.telemetry['features'] > 20 for step in steps] == [False] + [True] * 9
    assert comparison.equal, comparison.divergence
    assert replayed(path, from_tracks=True)[1].equal
    assert [item.what for item in told(path)] == [
        'photograph taken, by ~/capture_desired',
        'all features matched anew, by ~/redetect',
    ]


TRUE = Camera(1280, 1024, 769.2, 769.2, 635.0, 512.0)
OTHER = Camera(1280, 1024, 700.0, 700.0, 635.0, 512.0)
RAW = Camera(1280, 1024, 760.0, 760.0, 640.0, 500.0, (-0.2, 0.05, 0.0, 0.0))
AWAY = Pose.from_start(1.0, -3.5, 8.0)
PERIOD_NS = 90_909_091


def info(camera: Camera, stamp_ns: int, rectified: Camera | None = None):
    message = write.camera_info(camera, stamp_ns, 'camera')
    if rectified is not None:
        message.p = write.camera_info(rectified, 0, '').p
    return message


def recorded(bench, infos, **values) -> list[Message]:
    """Return all that a servo says and hears that is given one camera_info after the other."""
    listener, received = new_listener(bench.context)
    bench.add(listener)
    calibrate, send = bench.talk(CameraInfo, 'camera_info'), bench.talk(PointCloud2, 'tracks')
    node = bench.start(ServoNode, autostart=True, stale_timeout=60.0, max_latency=0.0, **values)
    world = PointWorld(PointSettings(), FixedRig(TRUE), seed=0)
    bench.settle()
    for number, message in enumerate(infos):
        stamp_ns = (number + 1) * PERIOD_NS
        message.header.stamp = write.stamp(stamp_ns)
        calibrate(message)
        bench.settle()
        send(write.features(world.observe(AWAY, number), stamp_ns, 'camera'))
        bench.until(lambda number=number: node.received > number, 'tracks to arrive')
        bench.settle()
    return received


def compared(path: Path, **overrides):
    with Bag(path) as bag:
        run = read_run(bag, assign_roles(bag, {}))
        steps = replay(bag, run, plan(bag, run, ReplayOverrides(**overrides))[0])
    return steps, compare(run, steps, 0.0)


def test_a_camera_changed_in_mid_run_holds_in_the_replay(bench, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(driving_inputs, 'DISTRUST_S', 1.5e-9 * PERIOD_NS)  # the first is refused
    messages = recorded(bench, [info(TRUE, 0)] * 4 + [info(OTHER, 0)] * 4 + [info(TRUE, 0)] * 4)
    steps, comparison = compared(write_bag(tmp_path / 'bag', messages))
    assert comparison.equal
    phases = [step.phase.value for step in steps]
    held = 4 + RESUMING_FRAMES - 1
    assert phases[3 : 5 + held] == ['displacing', *['holding'] * held, 'displacing']


@pytest.mark.parametrize('known', [True, False])
def test_rectified_images_are_replayed_as_such(bench, tmp_path, known) -> None:
    messages = recorded(bench, [info(RAW, 0, TRUE)] * 4, rectified=True)
    if not known:
        messages = [item for item in messages if item[0] != '/servo_node/settings']
    path = write_bag(tmp_path / 'bag', messages)
    changes = {'servo': {'autostart': True}}
    assert compared(path, rectified=not known, changes=changes)[1].equal
    if not known:
        assert not compared(path, changes=changes)[1].equal


@pytest.mark.parametrize('known', [True, False])
def test_cropped_images_are_replayed_as_such(bench, tmp_path, known) -> None:
    crop = Camera(1280, 1024, 769.2, 769.2, 300.0, 512.0)
    messages = recorded(bench, [info(crop, 0)] * 4, cropped=True)
    if not known:
        messages = [item for item in messages if item[0] != '/servo_node/settings']
    path = write_bag(tmp_path / 'bag', messages)
    changes = {'servo': {'autostart': True}}
    assert compared(path, cropped=not known, changes=changes)[1].equal
    if not known:
        with pytest.raises(InputError, match='camera_info cannot be used: the principal point'):
            compared(path, changes=changes)
