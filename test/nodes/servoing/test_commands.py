"""Commands rise by what the time between their going out allows, whatever the stamps say."""

import pytest
from servo_rig import AWAY, GOAL, Rig

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.supervisor import LATE_S

ACCELERATION = ServoSettings().max_angular_acceleration


@pytest.fixture
def rig(bench, clock) -> Rig:
    """Return a servo that drives, with a clock that stands."""
    return Rig(bench).drive()


def rise(rig: Rig, stamps_ns: int) -> float:
    """Return how much faster it turns by an image whose stamp is so much later."""
    before = abs(rig.twist.angular)
    rig.stamp_ns += stamps_ns
    rig.see()
    return abs(rig.twist.angular) - before


def test_an_image_right_after_the_last_command_gives_little_speed(rig) -> None:
    assert rise(rig, 300_000_000) <= ACCELERATION * LATE_S + 1e-9


def test_an_image_in_its_time_gives_what_the_ramp_allows(rig, clock) -> None:
    clock.go_on(0.09)
    assert rise(rig, 0) == pytest.approx(ACCELERATION * 0.0909, rel=0.01)


def test_where_time_waits_for_the_servo_stamps_alone_count(bench, clock) -> None:
    assert rise(Rig(bench, watchdog=False).drive(), 0) == pytest.approx(
        ACCELERATION * 0.0909, rel=0.01
    )


IMAGES = 4
SURE = {'memory': False}  # at the goal: who has no memory of views never doubts


def assert_watch_is_silent(rig: Rig) -> None:
    rig.bench.settle()
    count = len(rig.commands)
    rig.watch()
    rig.bench.settle()
    assert len(rig.commands) == count


def test_a_servo_that_waits_for_the_photograph_to_come_in_view_is_silent(bench) -> None:
    rig = Rig(bench)
    for _ in range(IMAGES):
        rig.show()
    assert (rig.phase, rig.commands) == ('waiting', [])


def test_that_while_is_a_second(bench, clock) -> None:
    rig = Rig(bench, **SURE)
    for seconds in (0.0, 0.95, 0.1):
        clock.go_on(seconds)
        rig.see(GOAL)
    assert (rig.phase, rig.twists()) == ('arrived', [STANDSTILL] * 2)


def test_the_next_run_has_its_own_end(bench, clock) -> None:
    rig = Rig(bench, **SURE)
    rig.see(GOAL)
    clock.go_on(2.0)
    rig.bench.call('servo_node/start')
    rig.see(AWAY)
    rig.bench.call('servo_node/reset')
    clock.go_on(2.0)
    count = len(rig.commands)
    rig.see(GOAL)
    assert rig.twists()[count:] == [STANDSTILL]


def test_after_a_reset_it_is_silent_at_once(bench, clock) -> None:
    rig = Rig(bench, **SURE)
    rig.see(GOAL)
    rig.bench.call('servo_node/reset')
    count = len(rig.commands)
    rig.show()
    assert (rig.phase, len(rig.commands)) == ('waiting', count)


@pytest.mark.parametrize('order', ['stop', 'reset'])
def test_an_order_that_stops_is_repeated_for_a_second(bench, clock, order) -> None:
    """A base that stops by nothing else may not have heard the first zero twist."""
    rig = Rig(bench, autostart=False)
    rig.see()
    assert bench.call('servo_node/start').success
    rig.drive()
    count = len(rig.commands)
    rig.bench.call(f'servo_node/{order}')
    bench.until(lambda: len(rig.commands) >= count + 4, 'zero twists without any image')
    assert rig.twists()[count:] == [STANDSTILL] * (len(rig.commands) - count)
    clock.go_on(1.001)
    assert_watch_is_silent(rig)
    count = len(rig.commands)
    rig.see()
    assert len(rig.commands) == count


def test_who_is_started_again_after_a_stop_is_not_stopped_by_it(bench, clock) -> None:
    rig = Rig(bench).drive()
    rig.bench.call('servo_node/stop')
    rig.bench.call('servo_node/start')
    rig.drive()
    assert_watch_is_silent(rig)


def test_a_robot_that_holds_is_told_to_stand_by_each_image(bench) -> None:
    rig = Rig(bench).drive()
    count = len(rig.commands)
    for _ in range(IMAGES):
        rig.show()
    assert (rig.phase, rig.twists()[count:]) == ('holding', [STANDSTILL] * IMAGES)


@pytest.mark.parametrize('show', [Rig.show, lambda rig: rig.see(GOAL)], ids=['waiting', 'arrived'])
def test_where_time_waits_for_the_servo_each_image_is_answered(bench, clock, show) -> None:
    rig = Rig(bench, watchdog=False, **SURE)
    for _ in range(IMAGES):
        show(rig)
        clock.go_on(2.0)
    assert rig.twists() == [STANDSTILL] * IMAGES
