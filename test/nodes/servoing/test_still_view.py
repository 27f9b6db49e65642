"""A camera that hangs stamps its last image anew: the robot does not drive on by it."""

from servo_rig import AWAY, Rig

from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL

STILL = 8  # images of one view: 0.73 s, stale_timeout is 0.5 s
NEARER = Pose(AWAY.x - 0.01, AWAY.y + 0.02, AWAY.theta)


def test_a_view_that_stands_still_while_the_robot_drives_stops_it(bench) -> None:
    rig = Rig(bench).drive()
    for _ in range(STILL):
        rig.see()
    assert rig.phase == 'holding'
    assert 'the very same for' in rig.node._state.reason
    assert rig.twists()[-1] == STANDSTILL


def test_no_drive_begins_anew_by_the_view_that_stands_still(bench) -> None:
    rig = Rig(bench).drive()
    for _ in range(STILL):
        rig.see()
    count = len(rig.commands)
    for _ in range(STILL):
        rig.see()
    assert rig.phase == 'holding'
    assert all(twist == STANDSTILL for twist in rig.twists()[count:])


def test_a_view_that_changes_again_is_driven_by(bench) -> None:
    rig = Rig(bench).drive()
    for _ in range(STILL):
        rig.see()
    rig.see(NEARER)
    assert rig.phase != 'holding'


def test_a_robot_that_stands_may_see_the_same_for_as_long_as_it_likes(bench) -> None:
    rig = Rig(bench, autostart=False)
    for _ in range(3 * STILL):
        rig.see()
    rig.node._run.active = True
    rig.drive()
