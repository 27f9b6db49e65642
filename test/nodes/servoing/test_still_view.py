"""A camera that hangs stamps its last image anew: the robot does not drive on by it."""

from servo_rig import AWAY, PERIOD_NS, Rig, WORLD

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.laws.phases.standing import RESUMING_FRAMES
from visual_servo_epipolar.messages import write

DISTRUST_S = 2.0  # as the servo has it
STILL = 8  # images of one view: 0.73 s, stale_timeout is 0.5 s


def hang(rig: Rig) -> None:
    """Show the same for a while, with new stamps."""
    for number in range(1, STILL + 1):
        features = WORLD.observe(AWAY, 0)
        rig.tell(write.features(features, rig.stamp_ns, 'camera_optical_frame', repeats=number))
        rig.stamp_ns += PERIOD_NS


def test_a_view_that_stands_still_while_the_robot_drives_stops_it(bench) -> None:
    rig = Rig(bench).drive()
    hang(rig)
    assert rig.phase == 'holding'
    assert 'the very same for' in rig.node._state.reason
    assert rig.twists()[-1] == STANDSTILL


def test_no_drive_begins_anew_by_the_view_that_stands_still(bench) -> None:
    rig = Rig(bench).drive()
    hang(rig)
    count = len(rig.commands)
    hang(rig)
    assert rig.phase == 'holding'
    assert all(twist == STANDSTILL for twist in rig.twists()[count:])


def test_a_view_that_changes_again_is_driven_by(bench) -> None:
    rig = Rig(bench).drive()
    hang(rig)
    for _ in range(RESUMING_FRAMES):
        assert rig.phase == 'holding'
        rig.see()
    assert rig.phase != 'holding'


def test_a_robot_that_stands_may_see_the_same_for_as_long_as_it_likes(bench) -> None:
    rig = Rig(bench, autostart=False)
    for _ in range(3):
        hang(rig)
    assert bench.call('servo_node/start').success
    rig.drive()


def show(rig: Rig, back: int) -> None:
    """Show an image that came last so many images ago, with a new stamp."""
    features = WORLD.observe(AWAY, 0)
    rig.tell(write.features(features, rig.stamp_ns, 'camera_optical_frame', back=back))
    rig.stamp_ns += PERIOD_NS


def test_an_image_of_another_time_stops_the_robot(bench) -> None:
    rig = Rig(bench).drive()
    rig.see()
    show(rig, 7)
    assert rig.phase == 'holding'
    assert 'of another time of the run' in rig.node._state.reason
    assert rig.twists()[-1] == STANDSTILL


def test_new_images_are_driven_by_again_only_after_a_while(bench) -> None:
    rig = Rig(bench).drive()
    rig.see()
    show(rig, 7)
    count = len(rig.commands)
    for _ in range(round(DISTRUST_S * 1e9 / PERIOD_NS) - 1):
        rig.see()
    assert all(twist == STANDSTILL for twist in rig.twists()[count:])
    rig.drive()


def test_a_robot_that_stands_may_see_what_came_before(bench) -> None:
    rig = Rig(bench, autostart=False)
    show(rig, 7)
    assert bench.call('servo_node/start').success
    rig.drive()


def test_the_last_image_once_more_is_none_of_another_time(bench) -> None:
    rig = Rig(bench).drive()
    show(rig, 1)
    assert rig.phase != 'holding'
