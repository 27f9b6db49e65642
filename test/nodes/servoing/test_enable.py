"""A heartbeat on ``enable``, where it is asked for, and what follows a hold."""

import pytest
from servo_rig import HandSetClock, Rig
from std_msgs.msg import Bool

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.laws.phases.standing import RESUMING_FRAMES
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import write

TIMEOUT_S, SECOND = 0.5, 1_000_000_000


class Enabled(Rig):
    """A servo that drives while it is enabled, on a steady clock that is set by hand."""

    def __init__(self, bench, **values) -> None:
        self._say = bench.talk(Bool, 'enable')
        super().__init__(bench, **{'stale_timeout': 60.0, 'enable_timeout': TIMEOUT_S, **values})
        enable = self.node._admission._enable
        enable._steady = self.clock = HandSetClock()

    def enable(self, value: bool = True) -> None:
        self._say(Bool(data=value))
        self.bench.settle()

    def drive(self) -> 'Enabled':
        self.enable()
        super().drive()
        return self

    def resume(self) -> None:
        """See as often as it takes to go on."""
        for _ in range(RESUMING_FRAMES):
            self.see()


def test_without_a_heartbeat_no_run_begins_and_that_is_said(bench) -> None:
    rig = Enabled(bench)
    rig.see()
    assert (rig.phase, rig.commands) == ('waiting', [])
    answer = bench.call('servo_node/start')
    text = 'armed, will drive once this is resolved: no message has come on /enable yet'
    assert text in answer.message
    rig.drive()


def test_a_heartbeat_that_ends_stops_the_robot_and_it_goes_on_with_the_next(bench) -> None:
    rig = Enabled(bench).drive()
    rig.clock.now_ns += round((TIMEOUT_S - 0.1) * SECOND)
    rig.node._on_watch()
    assert rig.node._state.phase.drives
    rig.clock.now_ns += round(0.2 * SECOND)
    bench.until(lambda: rig.phase == 'holding', 'the robot to hold, without any image')
    bench.settle()
    assert rig.twists()[-1] == STANDSTILL
    assert 'the last true on /enable is 0.6 s old' in rig.node._state.reason
    count = len(rig.commands)
    rig.resume()
    assert rig.phase == 'holding'
    assert all(twist == STANDSTILL for twist in rig.twists()[count:])
    rig.enable()
    rig.resume()
    assert rig.twists()[-1] != STANDSTILL


def test_a_false_stops_the_robot_at_once(bench) -> None:
    rig = Enabled(bench).drive()
    rig.enable(value=False)
    assert (rig.phase, rig.node._state.reason) == ('holding', '/enable is false')
    bench.until(lambda: rig.twists()[-1] == STANDSTILL, 'the zero twist')


def test_a_false_is_not_lost_by_a_true_that_comes_before_it_is_heard(bench) -> None:
    rig = Enabled(bench, resume='manual').drive()
    rig._say(Bool(data=False))
    rig.enable()
    assert rig.phase == 'holding'


def test_who_asks_for_no_heartbeat_does_not_hear_one(bench) -> None:
    rig = Enabled(bench, enable_timeout=0.0)
    rig.drive().enable(value=False)
    assert rig.node._state.phase.drives


def test_a_hold_for_want_of_it_ends_as_any_other(bench) -> None:
    rig = Enabled(bench, holding_timeout=0.3, stale_timeout=0.1, max_latency=0.0)
    rig.enable()
    rig.see()
    rig.enable(value=False)
    bench.until(lambda: rig.phase == 'failed', 'the run to end')
    assert rig.node._state.reason == 'held for 0.3 s: /enable is false'


def lost(rig: Rig) -> None:
    """Hold by tracks that show nothing."""
    rig.tell(write.features(Features(goal=1), rig.stamp_ns, 'camera'))
    rig.stamp_ns += 90_909_091
    assert rig.phase == 'holding'


def silent(rig: Rig) -> None:
    """Hold for want of tracks."""
    rig.node._run.lose('no new tracks for 0.51 s')


@pytest.mark.parametrize('hold', [lost, silent])
def test_after_a_hold_that_is_resumed_by_hand_it_stands_until_a_start(bench, hold) -> None:
    rig = Rig(bench, stale_timeout=60.0, resume='manual').drive()
    hold(rig)
    for _ in range(3 * RESUMING_FRAMES):
        rig.see()
    assert (rig.phase, rig.twists()[-1]) == ('holding', STANDSTILL)
    assert rig.node._standstill()[0].startswith('resume is manual: ')
    answer = bench.call('servo_node/start')
    assert (answer.success, answer.message) == (True, 'started')
    rig.see()
    assert rig.twists()[-1] != STANDSTILL


@pytest.mark.parametrize('hold', [lost, silent])
def test_by_default_it_goes_on_by_itself(bench, hold) -> None:
    rig = Rig(bench, stale_timeout=60.0).drive()
    hold(rig)
    for _ in range(RESUMING_FRAMES):
        rig.see()
    assert rig.twists()[-1] != STANDSTILL
