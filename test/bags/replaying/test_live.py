"""A run that is interrupted as on a robot: orders, silence, new gains; its replay is the same."""

from bagmaker import decoded, Message, new_listener, write_bag
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import Trigger

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.run import Happening, happenings, read_run
from visual_servo_epipolar.bags.reading.topics import assign_roles
from visual_servo_epipolar.bags.replaying.comparison import compare, Comparison
from visual_servo_epipolar.bags.replaying.plan import plan, ReplayOverrides
from visual_servo_epipolar.bags.replaying.replay import replay, ReplayedStep
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.nodes.tracker_node import TrackerNode

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
    servo.see(0, 5)
    servo.nodes[0].set_parameters([Parameter('stale_timeout', value=0.05)])
    bench.until(lambda: servo.nodes[0]._state.phase.value == 'holding', 'the watchdog')
    servo.nodes[0].set_parameters([Parameter('stale_timeout', value=60.0)])
    servo.see(5, 12)
    events = [decoded(item).data for item in servo.received if item[0] == '/servo_node/events']
    assert any('"lost"' in text and 'no new tracks for' in text for text in events)
    steps, comparison = replayed(write_bag(tmp_path / 'silence', servo.received))
    assert len(steps) == 12
    assert comparison.equal, comparison.divergence


def test_a_photograph_taken_on_the_way_and_redetection_are_replayed(
    bench, small_run, tmp_path
) -> None:
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
