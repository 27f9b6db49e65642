"""A photograph that changes in mid-run: the goal is another, and nobody drives there silently."""

from dataclasses import replace

from bagmaker import Message, new_listener, write_bag
import pytest
from servo_rig import AWAY, PERIOD_NS, Rig, WORLD

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.run import read_run
from visual_servo_epipolar.bags.reading.topics import assign_roles
from visual_servo_epipolar.bags.replaying.comparison import compare
from visual_servo_epipolar.bags.replaying.plan import plan, ReplayOverrides
from visual_servo_epipolar.bags.replaying.replay import replay
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.goal import NO_GOAL
from visual_servo_epipolar.core.laws.standing import RESUMING_FRAMES
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import write

FIRST, SECOND = 7, 4_000_000_000
CHANGED = 'the photograph has changed in mid-run'


class Servo(Rig):
    """A servo node that is given tracks of one photograph or another."""

    def __init__(self, bench, **values) -> None:
        super().__init__(bench, stale_timeout=60.0, **values)

    def show(self, goal, *, blank=False) -> Twist:
        """Send tracks of ``goal``, and return the command."""
        features = Features() if blank else WORLD.observe(AWAY, 0)
        self.tell(write.features(replace(features, goal=goal), self.stamp_ns, 'camera'))
        self.stamp_ns += PERIOD_NS
        return self.twist

    def driving(self, goal=FIRST):
        while self.show(goal) == STANDSTILL:
            pass
        return self


def test_another_photograph_in_mid_run_stops_the_robot_for_good(bench) -> None:
    servo = Servo(bench, holding_timeout=0.5).driving()
    for _ in range(8):
        assert servo.show(SECOND) == STANDSTILL
        assert CHANGED in servo.reason
    assert servo.phase == 'failed'
    bench.until(lambda: bench.logged(f'{CHANGED}: its tracks lead to another goal'), 'the log')


def test_so_does_one_that_had_to_be_looked_for(bench) -> None:
    servo = Servo(bench, holding_timeout=5.0).driving()
    for _ in range(3):
        servo.show(SECOND, blank=True)
    for _ in range(3):
        assert (servo.show(SECOND), servo.phase) == (STANDSTILL, 'holding')
        assert servo.reason.startswith(CHANGED)


def test_the_run_goes_on_with_the_photograph_it_began_with(bench) -> None:
    servo = Servo(bench).driving()
    servo.show(SECOND)
    servo.driving(FIRST)


def test_another_photograph_begins_a_new_run_after_a_reset(bench) -> None:
    servo = Servo(bench).driving()
    servo.show(SECOND)
    bench.call('servo_node/reset')
    servo.driving(SECOND)


@pytest.mark.parametrize('goal', [FIRST, NO_GOAL])
def test_the_same_photograph_or_one_that_nobody_tells_is_no_change(bench, goal) -> None:
    servo = Servo(bench).driving()
    for _ in range(3):
        assert servo.show(goal) != STANDSTILL


def test_a_replay_of_it_does_as_the_robot_did(bench, tmp_path) -> None:
    listener, received = new_listener(bench.context)
    bench.add(listener)
    messages: list[Message] = received
    servo = Servo(bench).driving()
    for goal, blank in ((SECOND, False), (SECOND, True), (SECOND, False), (FIRST, False)):
        servo.show(goal, blank=blank)
    servo.driving()
    with Bag(write_bag(tmp_path / 'bag', messages)) as bag:
        run = read_run(bag, assign_roles(bag, {}))
        steps = replay(bag, run, plan(bag, run, ReplayOverrides())[0])
    assert compare(run, steps, 0.0).equal
    assert [step.phase.value for step in steps].count('holding') == 2 + RESUMING_FRAMES
