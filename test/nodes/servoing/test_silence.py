"""Silence: outside of a run others may drive; in it the servo has the last word."""

from dataclasses import replace

import pytest
from servo_rig import AWAY, GOAL, HandSetClock, Rig

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.servoing import commands

IMAGES = 4
SURE = {'memory': False}  # at the goal: who has no memory of views never doubts


def blind(rig: Rig) -> None:
    rig.tell(write.features(Features(), rig.stamp_ns, 'camera'))
    rig.stamp_ns += 90_000_000


def assert_watch_is_silent(rig: Rig) -> None:
    rig.bench.settle()
    count = len(rig.commands)
    rig.node._on_watch()
    rig.bench.settle()
    assert len(rig.commands) == count


def test_a_servo_that_waits_for_the_photograph_to_come_in_view_is_silent(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0)
    for _ in range(IMAGES):
        blind(rig)
    assert (rig.phase, rig.commands) == ('waiting', [])


def test_a_run_ends_with_zero_twists_for_a_while(bench, monkeypatch) -> None:
    monkeypatch.setattr(commands, 'SETTLING_S', 60.0)
    rig = Rig(bench, stale_timeout=60.0, **SURE)
    for _ in range(IMAGES):
        rig.see(GOAL)
    assert (rig.phase, rig.twists()) == ('arrived', [STANDSTILL] * IMAGES)


def test_after_that_it_is_silent(bench, monkeypatch) -> None:
    monkeypatch.setattr(commands, 'SETTLING_S', 0.0)
    rig = Rig(bench, stale_timeout=60.0, **SURE)
    for _ in range(IMAGES):
        rig.see(GOAL)
    assert (rig.phase, rig.twists()) == ('arrived', [STANDSTILL])


def test_that_while_is_a_second(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0, **SURE)
    clock = rig.node._commands._steady = HandSetClock()
    for seconds in (0.0, 0.95, 0.1):
        clock.now_ns += round(seconds * 1e9)
        rig.see(GOAL)
    assert (rig.phase, rig.twists()) == ('arrived', [STANDSTILL] * 2)


def test_the_next_run_has_its_own_end(bench, monkeypatch) -> None:
    monkeypatch.setattr(commands, 'SETTLING_S', 0.0)
    rig = Rig(bench, stale_timeout=60.0, **SURE)
    rig.see(GOAL)
    rig.bench.call('servo_node/start')
    rig.see(AWAY)
    rig.bench.call('servo_node/reset')
    count = len(rig.commands)
    rig.see(GOAL)
    assert rig.twists()[count:] == [STANDSTILL]


def test_after_a_reset_it_is_silent_at_once(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0, **SURE)
    rig.node._commands._steady = HandSetClock()
    rig.see(GOAL)
    rig.bench.call('servo_node/reset')
    count = len(rig.commands)
    blind(rig)
    assert (rig.phase, len(rig.commands)) == ('waiting', count)


def test_an_order_to_stop_is_repeated_for_a_second(bench) -> None:
    """A base that stops by nothing else may not have heard the first zero twist."""
    rig = Rig(bench, stale_timeout=60.0).drive()
    clock = rig.node._commands._steady = HandSetClock()
    count = len(rig.commands)
    rig.bench.call('servo_node/stop')
    bench.until(lambda: len(rig.commands) >= count + 4, 'zero twists without any image')
    assert rig.twists()[count:] == [STANDSTILL] * (len(rig.commands) - count)
    clock.now_ns += 1_000_000_001
    assert_watch_is_silent(rig)


def test_an_order_to_begin_anew_that_stops_the_robot_is_repeated_as_well(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0).drive()
    clock = rig.node._commands._steady = HandSetClock()
    rig.node._settings = replace(rig.node._settings, autostart=False)
    count = len(rig.commands)
    rig.bench.call('servo_node/reset')
    bench.until(lambda: len(rig.commands) >= count + 4, 'zero twists without any image')
    assert rig.twists()[count:] == [STANDSTILL] * (len(rig.commands) - count)
    clock.now_ns += 1_000_000_001
    assert_watch_is_silent(rig)


def test_who_is_started_again_after_a_stop_is_not_stopped_by_it(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0).drive()
    rig.node._commands._steady = HandSetClock()
    rig.bench.call('servo_node/stop')
    rig.bench.call('servo_node/start')
    rig.drive()
    assert_watch_is_silent(rig)


def test_a_robot_that_holds_is_told_to_stand_by_each_image(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0).drive()
    count = len(rig.commands)
    for _ in range(IMAGES):
        blind(rig)
    assert (rig.phase, rig.twists()[count:]) == ('holding', [STANDSTILL] * IMAGES)


@pytest.mark.parametrize('show', [blind, lambda rig: rig.see(GOAL)], ids=['waiting', 'arrived'])
def test_where_time_waits_for_the_servo_each_image_is_answered(bench, monkeypatch, show) -> None:
    monkeypatch.setattr(commands, 'SETTLING_S', 0.0)
    rig = Rig(bench, watchdog=False, **SURE)
    for _ in range(IMAGES):
        show(rig)
    assert rig.twists() == [STANDSTILL] * IMAGES
