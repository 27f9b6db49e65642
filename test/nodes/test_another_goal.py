"""A photograph that changes in mid-run: the goal is another, and nobody drives there silently."""

from dataclasses import replace

from bagmaker import Message, new_listener, write_bag
import pytest
from sensor_msgs.msg import CameraInfo, PointCloud2

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.run import read_run
from visual_servo_epipolar.bags.reading.topics import assign_roles
from visual_servo_epipolar.bags.replaying.comparison import compare
from visual_servo_epipolar.bags.replaying.plan import plan, ReplayOverrides
from visual_servo_epipolar.bags.replaying.replay import replay
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL
from visual_servo_epipolar.core.goal import NO_GOAL
from visual_servo_epipolar.core.laws.phases.standing import RESUMING_FRAMES
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.simulation.mounts.mounting import FixedRig
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld

CAMERA = Camera(1280, 1024, 769.2, 769.2, 635.0, 512.0)
AWAY = Pose.from_start(1.0, -3.5, 8.0)
PERIOD_NS = 90_909_091
FIRST, SECOND = 7, 4_000_000_000
CHANGED = 'the photograph has changed in mid-run'


class Servo:
    """A servo node that is given tracks of one photograph or another."""

    def __init__(self, bench, **values) -> None:
        self.bench, self.stamp_ns = bench, 0
        self._send = bench.talk(PointCloud2, 'tracks')
        calibrate = bench.talk(CameraInfo, 'camera_info')
        self.node = bench.start(
            ServoNode, autostart=True, max_latency=0.0, stale_timeout=60.0, **values
        )
        self._world = PointWorld(PointSettings(), FixedRig(CAMERA), seed=0)
        calibrate(write.camera_info(CAMERA, 1, 'camera'))
        bench.settle()

    def see(self, goal, *, blank=False):
        """Send tracks of ``goal``, wait until they are taken in, and return the state."""
        self.stamp_ns += PERIOD_NS
        features = Features() if blank else self._world.observe(AWAY, 0)
        features = replace(features, goal=goal)
        self._send(write.features(features, self.stamp_ns, 'camera'))
        self.bench.until(lambda: self.node._run.stamp_ns == self.stamp_ns, 'tracks to arrive')
        self.bench.settle()
        return self.node._state

    def driving(self, goal=FIRST):
        while self.see(goal).twist == STANDSTILL:
            pass
        return self


def test_another_photograph_in_mid_run_stops_the_robot_for_good(bench) -> None:
    servo = Servo(bench, holding_timeout=0.5).driving()
    for _ in range(8):
        state = servo.see(SECOND)
        assert state.twist == STANDSTILL
        assert CHANGED in state.reason
    assert state.phase.value == 'failed'
    bench.until(lambda: bench.logged(f'{CHANGED}: its tracks lead to another goal'), 'the log')


def test_so_does_one_that_had_to_be_looked_for(bench) -> None:
    servo = Servo(bench, holding_timeout=5.0).driving()
    for _ in range(3):
        servo.see(SECOND, blank=True)
    for _ in range(3):
        state = servo.see(SECOND)
        assert (state.phase.value, state.twist) == ('holding', STANDSTILL)
        assert state.reason.startswith(CHANGED)


def test_the_run_goes_on_with_the_photograph_it_began_with(bench) -> None:
    servo = Servo(bench).driving()
    servo.see(SECOND)
    servo.driving(FIRST)


def test_another_photograph_begins_a_new_run_after_a_reset(bench) -> None:
    servo = Servo(bench).driving()
    servo.see(SECOND)
    bench.call('servo_node/reset')
    servo.driving(SECOND)


@pytest.mark.parametrize('goal', [FIRST, NO_GOAL])
def test_the_same_photograph_or_one_that_nobody_tells_is_no_change(bench, goal) -> None:
    servo = Servo(bench).driving()
    for _ in range(3):
        assert servo.see(goal).twist != STANDSTILL


def test_a_replay_of_it_does_as_the_robot_did(bench, tmp_path) -> None:
    listener, received = new_listener(bench.context)
    bench.add(listener)
    messages: list[Message] = received
    servo = Servo(bench).driving()
    for goal, blank in ((SECOND, False), (SECOND, True), (SECOND, False), (FIRST, False)):
        servo.see(goal, blank=blank)
    servo.driving()
    with Bag(write_bag(tmp_path / 'bag', messages)) as bag:
        run = read_run(bag, assign_roles(bag, {}))
        steps = replay(bag, run, plan(bag, run, ReplayOverrides())[0])
    assert compare(run, steps, 0.0).equal
    assert [step.phase.value for step in steps].count('holding') == 2 + RESUMING_FRAMES
