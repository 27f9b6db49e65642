"""Why a run stands, holds or fails, by its latest reason."""

import pytest
from servo_rig import Rig, some

from visual_servo_epipolar.nodes.driving_inputs import NO_CAMERA


def test_without_a_camera_that_is_the_reason_though_tracks_stay_away_too(bench) -> None:
    rig = Rig(bench, calibrated=False, stale_timeout=0.1)
    bench.pass_time(0.15)
    rig.run.report()
    assert rig.reason == f'will drive once this is resolved: {NO_CAMERA}'
    assert rig.phase == 'waiting'


def test_a_robot_that_holds_stands_for_the_latest_reason(bench, clock) -> None:
    rig = Rig(bench).drive()
    rig.run.refuse('an image of last year')
    rig.run.trouble = 'an image of this year'
    assert (rig.phase, rig.reason) == ('holding', 'an image of last year')
    rig.run.report()
    assert rig.reason == 'an image of this year'


@pytest.mark.parametrize(
    ('refused', 'seconds', 'reason'),
    [(True, 0.4, 'an image of last year, 0.4 s ago'), (False, 4.9, 'no tracks for 4.9 s')],
)
def test_a_run_fails_for_the_latest_reason_with_its_age(
    bench, clock, refused, seconds, reason
) -> None:
    rig = Rig(bench).drive()
    rig.run.lose('no new tracks for 0.51 s')
    if refused:
        rig.run.refuse('an image of last year')
    clock.go_on(seconds)
    rig.run.time_out(5.0)
    assert rig.reason == f'tracks lost or untrusted for 5 s: {reason}'


@pytest.mark.parametrize('count', [3, 0], ids=['few', 'none'])
def test_a_hold_that_images_end_has_the_reason_of_the_last_of_them(bench, count) -> None:
    rig = Rig(bench, holding_timeout=1.0).drive()
    rig.run.lose('no new tracks for 0.51 s')
    rig.goal = 1
    while rig.phase == 'holding':
        rig.show(some(count))
    text = f'tracks lost or untrusted for 1 s: {count} features, 12 needed, 0.0 s ago'
    assert (rig.phase, rig.reason) == ('failed', text)
