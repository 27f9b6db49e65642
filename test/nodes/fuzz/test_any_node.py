"""Whatever comes on any subscription of a node: it lives, says one line, stays small."""

from bag_reading import read_back
from bench import Bench
import fuzzing
from geometry_msgs.msg import TwistStamped
from lifecycle_msgs.srv import ChangeState
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, PointCloud2
from servo_rig import AWAY, CAMERA, PERIOD_NS, Rig, STAMP_NS, tracks
import small_cameras
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes.camera_node import CameraNode
from visual_servo_epipolar.nodes.commands import Commands
from visual_servo_epipolar.nodes.dock_node import DockNode
from visual_servo_epipolar.nodes.recorder_node import RecorderNode
from visual_servo_epipolar.nodes.route_node import RouteNode
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.nodes.tracker_node import TrackerNode
from visual_servo_epipolar.nodes.unicycle_node import UnicycleNode

TINY = small_cameras.sized(64, 48, 38.0, 31.5, 23.5)
NODES = (ServoNode, TrackerNode, RecorderNode, DockNode, RouteNode, UnicycleNode, CameraNode)
KINDS = [
    pytest.param(DockNode, {}, id='dock'),
    pytest.param(DockNode, {'autostart_node': False}, id='dock that is not active'),
    pytest.param(TrackerNode, {}, id='tracker'),
    pytest.param(TrackerNode, {'transport': 'compressed'}, id='tracker of pictures'),
    pytest.param(RouteNode, {}, id='route'),
    pytest.param(UnicycleNode, {'rate': 1.0}, id='base'),
    pytest.param(UnicycleNode, {'rate': 1.0, 'enable_stamped_cmd_vel': True}, id='stamped base'),
    pytest.param(UnicycleNode, {'lockstep': True, 'begin': False}, id='base in lockstep'),
    pytest.param(CameraNode, TINY, id='camera'),
]


@pytest.mark.parametrize(('kind', 'values'), KINDS)
def test_a_node_outlives_all_that_it_hears(bench: Bench, kind, values) -> None:
    node = bench.start(kind, **values)

    def tell(rng, number: int) -> None:
        fuzzing.sent_to(node, rng)
        if number % 20 == 0:
            bench.executor.spin_once(timeout_sec=0.0)

    fuzzing.assert_stays_small(tell, 2)
    bench.settle()
    assert not [log for log in bench.logs if '\n' in log.msg or len(log.msg) > 500]


def test_the_base_never_leaves_its_limits(bench: Bench) -> None:
    truth = bench.listen(Odometry, 'ground_truth')
    node, rng = bench.start(UnicycleNode, lockstep=True, begin=False), np.random.default_rng(3)
    limits = [node.get_parameter(f'max_{name}').value * 1.01 for name in ('linear', 'angular')]
    for _ in range(fuzzing.COUNT):
        fuzzing.sent_to(node, rng)
        bench.executor.spin_once(timeout_sec=0.0)
    bench.settle()
    assert truth
    for message in truth:
        twist, pose = read.twist(message.twist), read.pose(message)
        assert abs(twist.linear) <= limits[0] and abs(twist.angular) <= limits[1]
        assert np.isfinite([pose.x, pose.y, pose.theta]).all()


HEAD = 150  # bytes: sizes and names of fields are there


def damaged(data: bytes, rng) -> bytes:
    """Return part of ``data``, and some of its first bytes by others."""
    changed = bytearray(data[: int(rng.choice([len(data), rng.integers(4, len(data))]))])
    for _ in range(int(rng.integers(1, 6))):
        changed[int(rng.integers(4, min(len(changed), HEAD) + 1)) - 1] = int(rng.integers(0, 256))
    return bytes(changed)


def test_a_servo_outlives_bytes_that_are_no_message(bench) -> None:
    rig, rng = Rig(bench, autostart=False), np.random.default_rng(7)
    cloud = serialize_message(tracks())
    info = serialize_message(write.camera_info(CAMERA, 0, 'camera'))
    for _ in range(fuzzing.COUNT):
        rig.send(damaged(cloud, rng))
        rig.calibrate(damaged(info, rng))
        bench.executor.spin_once(timeout_sec=0.01)
    bench.settle()
    assert all(twist == STANDSTILL for twist in rig.twists())
    rig.calibrate(write.camera_info(CAMERA, 0, 'camera'))
    rig.see()
    assert bench.call('servo_node/start').success
    rig.drive()


ENDS = {5, 6, 7}  # transitions after which nothing is asked any more


def asked(node, kind, rng):
    """Return a request; of parameters mostly those that the node has."""
    request = fuzzing.anything(kind.Request, rng)
    if kind is ChangeState and (request.transition.id in ENDS or rng.random() < 0.7):
        request.transition.id = int(rng.choice([0, 1, 2, 3, 4, 10, 99]))
    if kind in (SetParameters, SetParametersAtomically):
        names = [name for name in node.get_parameters_by_prefix('') if name != 'use_sim_time']
        for item in request.parameters:
            item.name = str(rng.choice(names))
            item.value.type = int(rng.choice([*range(11), 255]))
    return request


@pytest.mark.parametrize('kind', NODES)
def test_every_request_is_answered(bench: Bench, kind, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)  # bags may be asked for
    node = bench.start(kind, **(TINY if kind is CameraNode else {}))

    def ask(rng, _: int) -> None:
        for service in list(node.services):
            request = fuzzing.wired(asked(node, service.srv_type, rng))
            answer = service.callback(request, service.srv_type.Response())
            fuzzing.wired(answer)

    fuzzing.assert_stays_small(ask, 5, fuzzing.COUNT // 4)
    bench.settle()


MAX_LINEAR, MAX_ANGULAR = 0.4, 0.5


class Fuzzed(Rig):
    """A servo that is told nonsense, and each twist that it commands."""

    def __init__(self, bench, monkeypatch, **values) -> None:
        super().__init__(bench, **values)
        self.sent = []
        send = Commands.send

        def listen(commands, command, stamp_ns) -> None:
            self.sent.append((command.twist, self.run.active, self.run.state.phase))
            send(commands, command, stamp_ns)

        monkeypatch.setattr(Commands, 'send', listen)

    def hand(self, topic: str, message) -> None:
        """Hand a message to all that subscribe to ``topic``, as it comes by the wire."""
        message = fuzzing.wired(message)
        for item in list(self.node.subscriptions):
            if item.topic_name == topic:
                item.callback(message)

    def calm(self) -> None:
        """Make the nonsense of before undone."""
        self.run.stop()
        self.hand('/stop_button', Bool(data=False))
        self.hand('/camera_info', write.camera_info(CAMERA, 0, 'camera'))

    def order(self, name: str) -> bool:
        """Call a service as it is called by the wire; return its success."""
        (service,) = (it for it in self.node.services if it.srv_name.endswith(f'/{name}'))
        return bool(service.callback(Trigger.Request(), Trigger.Response()).success)

    def drives(self) -> bool:
        """Return whether a run that begins now moves the robot."""
        self.calm()
        self.hand('/tracks', tracks(AWAY, STAMP_NS - PERIOD_NS))
        assert self.order('start')
        count = len(self.sent)
        for number in range(5):
            self.hand('/tracks', tracks(AWAY, STAMP_NS + number * PERIOD_NS))
        return any(twist != STANDSTILL for twist, *_ in self.sent[count:])


def nonsense(rig: Fuzzed, rng) -> None:
    """Send one message to each subscription."""
    for topic, kind in {(it.topic_name, it.msg_type) for it in rig.node.subscriptions}:
        rig.hand(topic, fuzzing.anything(kind, rng))
    rig.hand('/camera_info', fuzzing.nearly_camera(rng))
    rig.hand('/tracks', fuzzing.nearly_tracks(rng, int(rng.integers(0, 2**33))))


def check(rig: Fuzzed) -> None:
    """Hold what was commanded against limits, and against the run that it belongs to."""
    for twist, active, phase in rig.sent:
        assert abs(twist.linear) <= MAX_LINEAR and abs(twist.angular) <= MAX_ANGULAR
        assert twist == STANDSTILL or (active and phase.drives)
    rig.sent.clear()


def test_outside_of_a_run_nothing_moves_the_robot(bench, monkeypatch) -> None:
    rig = Fuzzed(bench, monkeypatch, autostart=False)

    def end() -> float:
        assert all(twist == STANDSTILL for twist, *_ in rig.sent)
        check(rig)
        return 0.0

    fuzzing.assert_stays_small(lambda rng, _: nonsense(rig, rng), 0, end=end)
    assert rig.drives()


def test_in_a_run_the_robot_keeps_to_its_limits(bench, monkeypatch) -> None:
    rig, moved, count = Fuzzed(bench, monkeypatch), [], fuzzing.COUNT // 2

    def run(rng, number: int) -> None:
        stamp_ns = STAMP_NS + 3 * number * PERIOD_NS
        rig.calm()
        rig.hand('/tracks', tracks(AWAY, stamp_ns))
        assert rig.order('start')
        for k in range(1, 4):
            rig.hand('/tracks', tracks(AWAY, stamp_ns + k * PERIOD_NS))
        moved.append(rig.sent[-1][0] != STANDSTILL)
        nonsense(rig, rng)
        check(rig)

    fuzzing.assert_stays_small(run, 1, count)
    assert sum(moved[:count]) > count // 2 < sum(moved[count:])


RECORDED = {
    'tracks': PointCloud2,
    'camera_info': CameraInfo,
    'odom': Odometry,
    'cmd_vel': TwistStamped,
    'phase': String,
    'stop_button': Bool,
}
BATCH = 10  # messages between two looks at what has come


def test_all_that_is_published_is_in_the_bag_byte_for_byte(bench: Bench, tmp_path) -> None:
    """Also what no subscriber could read: it is recorded as it came."""
    talk = {name: bench.talk(kind, name) for name, kind in RECORDED.items()}
    node = bench.start(
        RecorderNode, bag=str(tmp_path / 'bag'), topics=tuple(RECORDED), report=False
    )
    bench.until(lambda: node.ready, 'the topics to be recorded')
    bench.settle()
    sent = []

    def tell(rng, number: int) -> None:
        for name, kind in RECORDED.items():
            data = serialize_message(fuzzing.anything(kind, rng))
            if rng.random() < 0.3:
                data = damaged(data, rng)
            talk[name](data)
            sent.append((f'/{name}', data))
        if number % BATCH == 0:
            bench.until(lambda: node.received == len(sent), 'what was sent')

    def end() -> float:  # how much this test itself keeps
        bench.until(lambda: node.received == len(sent), 'what was sent')
        return 100e-6 * len(sent) + sum(len(data) for _, data in sent) / 2e6

    fuzzing.assert_stays_small(tell, 6, end=end)
    assert not node.stop().error
    written = sorted((name, bytes(data)) for name, _, data in read_back(tmp_path / 'bag'))
    assert written == sorted(sent)
