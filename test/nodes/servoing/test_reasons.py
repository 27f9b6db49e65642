"""Why the robot stands, as the servo says it: the nearest cause, and no other in its place."""

import pytest
from servo_rig import Rig

from visual_servo_epipolar.nodes.servoing.inputs.camera import NO_CAMERA


def test_without_a_camera_that_is_the_reason_though_tracks_stay_away_too(bench) -> None:
    rig = Rig(bench, calibrated=False, stale_timeout=0.1)
    bench.until(lambda: rig.node._watch.is_stale, 'tracks to stay away')
    assert rig.node._standstill() == (f'drives as soon as this is over: {NO_CAMERA}', True)
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
