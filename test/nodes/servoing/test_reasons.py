"""Why the robot stands, as the servo says it: the nearest cause, and no other in its place."""

from dataclasses import replace

import pytest
from servo_rig import AWAY, HandSetClock, PERIOD_NS, Rig, WORLD

from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.servoing.camera import NO_CAMERA


def test_without_a_camera_that_is_the_reason_though_tracks_stay_away_too(bench) -> None:
    rig = Rig(bench, calibrated=False, stale_timeout=0.1)
    bench.until(lambda: rig.node._is_stale, 'tracks to stay away')
    assert rig.node._standstill() == (f'will drive once this is resolved: {NO_CAMERA}', True)
    assert rig.phase == 'waiting'


def test_a_robot_that_holds_stands_for_the_latest_reason(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0).drive()
    rig.node._run.refuse('an image of last year')
    rig.node._run.trouble = 'an image of this year'
    assert (rig.phase, rig.node._state.reason) == ('holding', 'an image of last year')
    assert rig.node._standstill() == ('an image of this year', True)


@pytest.mark.parametrize('later_ns', [0, -1], ids=['repeated', 'backwards'])
def test_where_time_waits_for_the_servo_stamps_that_do_not_advance_are_said(
    bench, later_ns
) -> None:
    rig = Rig(bench, watchdog=False)
    rig.see()
    assert not bench.logged('the stamps do not advance')
    rig.node._run.active = False  # nor does a step say it
    rig.stamp_ns = rig.node._run.stamp_ns + later_ns
    rig.see()
    bench.until(lambda: bool(bench.logged('the stamps do not advance')), 'the warning')


def test_a_run_fails_for_the_latest_reason_with_its_age(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0).drive()
    run = rig.node._run
    run.lose('no new tracks for 0.51 s')
    run.refuse('an image of last year')
    freshness = run.freshness
    freshness.hear()
    clock = HandSetClock()
    clock.now_ns = freshness.clock.now().nanoseconds + 400_000_000
    freshness.clock = clock
    run.time_out(5.0)
    reason = rig.node._state.reason
    assert reason.startswith('tracks lost or untrusted for 5 s: an image of last year, 0.4')


def test_where_tracks_end_in_a_hold_it_fails_for_that(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0).drive()
    run = rig.node._run
    run.lose('an image of last year')
    clock = HandSetClock()
    clock.now_ns = run.freshness._heard_ns + 4_900_000_000
    run.freshness.clock = clock
    run.time_out(5.0)
    assert rig.node._state.reason == 'tracks lost or untrusted for 5 s: no tracks for 4.9 s'


@pytest.mark.parametrize('count', [3, 0], ids=['few', 'none'])
def test_a_hold_that_images_end_has_the_reason_of_the_last_of_them(bench, count) -> None:
    rig = Rig(bench, stale_timeout=60.0, holding_timeout=1.0).drive()
    rig.node._run.lose('no new tracks for 0.51 s')
    seen = WORLD.observe(AWAY, 0)
    columns = (seen.ids, seen.current, seen.desired, seen.ages, seen.errors)
    few = Features(*(column[:count] for column in columns))
    while rig.phase == 'holding':
        rig.tell(write.features(replace(few, goal=1), rig.stamp_ns, 'camera'))
        rig.stamp_ns += PERIOD_NS
    text = f'tracks lost or untrusted for 1 s: {count} features, 12 needed, 0.0 s ago'
    assert (rig.phase, rig.node._state.reason) == ('failed', text)


def test_a_photograph_that_changed_stays_the_reason_of_a_hold(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0, holding_timeout=1.0)
    for goal in (1, 1, 2):
        rig.tell(
            write.features(replace(WORLD.observe(AWAY, 0), goal=goal), rig.stamp_ns, 'camera')
        )
        rig.stamp_ns += PERIOD_NS
    while rig.phase == 'holding':
        rig.tell(write.features(replace(WORLD.observe(AWAY, 0), goal=2), rig.stamp_ns, 'camera'))
        rig.stamp_ns += PERIOD_NS
    assert rig.phase == 'failed'
    assert 'the photograph has changed in mid-run' in rig.node._state.reason


def test_where_clock_ends_with_the_tracks_that_is_said_as_well(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0).drive()
    run = rig.node._run
    run.lose('an image of last year')
    run.freshness._node_clock = run.freshness.clock = HandSetClock()
    run.freshness.clock_stands_still()
    run.freshness.clock = HandSetClock()
    run.freshness.clock.now_ns = run.freshness._heard_ns + 4_900_000_000
    run.time_out(5.0)
    assert rig.node._state.reason.endswith(': no tracks for 4.9 s, and /clock stands still')
