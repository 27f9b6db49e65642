"""The second world itself: its lens, its mast, its base and its judge are what they say."""

import math

from hypothesis import given
import numpy as np
import pytest
from second_world.robot import (
    DEAD_TIME,
    excursion,
    GOAL,
    Mast,
    Moment,
    RIGHT_WHEEL,
    Robot,
    TRACK,
    wrong_geometry_s,
)
from second_world.scene import box, Lens, Painter, panel
from strategies import floats, poses_behind_the_goal

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose

LENS = Lens((160, 120), 140.0, (81.0, 58.5), (-0.12, 0.03, 0.0006, -0.0004))
CENTRED = Mast(ahead=0.0, aside=0.0)


def test_the_lens_is_that_of_the_calibration() -> None:
    camera = Camera(160, 120, 140.0, 140.0, 81.0, 58.5, LENS.coefficients)
    x, y = LENS.ideal_points()
    pixels = camera.pixels_of(np.column_stack([x.ravel(), y.ravel()])).reshape(120, 160, 2)
    u, v = np.meshgrid(np.arange(160.0), np.arange(120.0))
    np.testing.assert_allclose(pixels, np.dstack([u, v]), atol=1e-6)


@pytest.fixture(scope='module')
def shared() -> Painter:
    return Painter(LENS, 0)


@pytest.fixture
def painter(shared: Painter, monkeypatch: pytest.MonkeyPatch) -> Painter:
    """Return a painter of an empty room."""
    monkeypatch.setattr(shared, '_room', [])
    monkeypatch.setattr(shared, '_things', [])
    return shared


def test_a_thing_is_where_the_lens_has_it(painter: Painter) -> None:
    sheet = panel(np.random.default_rng(0), (0.3, 2.0, 0.8), (0.2, 0, 0), (0, 0, -0.2), 0.0)
    for level in sheet.pyramid:
        level[:] = 255
    painter._things = [sheet]
    axes, centre = CENTRED.camera(GOAL)
    bright = painter.picture(axes, centre, 0) > 180
    middle = (sheet.middle - centre) @ axes
    x, y = LENS.distorted(middle[0] / middle[2], middle[1] / middle[2])
    found = np.argwhere(bright).mean(axis=0)[::-1]
    expected = [140.0 * x + 81.0, 140.0 * y + 58.5]
    np.testing.assert_allclose(found, expected, atol=0.5)
    # OpenCV paints the outline as well: half a pixel more on each side.
    assert bright.sum() == pytest.approx((140.0 * 0.2 / 2.0 + 1.0) ** 2, rel=0.1)


def test_what_is_near_hides_what_is_far(painter: Painter) -> None:
    rng = np.random.default_rng(0)
    near, far = box(rng, 0.0, 1.0, (0.3, 0.2, 0.7)), box(rng, 0.0, 2.0, (0.3, 0.2, 0.7))
    for shade, thing in ((20, near), (230, far)):
        for face in thing:
            for level in face.pyramid:
                level[:] = shade
    axes, centre = CENTRED.camera(GOAL)
    pictures = []
    for things in ([*near, *far], [*far, *near]):
        painter._things = things
        pictures.append(painter.picture(axes, centre, 0))
    np.testing.assert_array_equal(*pictures)
    assert pictures[0][58, 81] < 40


def test_pictures_follow_from_seed_place_and_frame_alone() -> None:
    axes, centre = Mast().camera((0.5, -2.0, 1.6))
    painter, same = Painter(LENS, 3), Painter(LENS, 3)
    one = painter.picture(axes, centre, 7)
    np.testing.assert_array_equal(one, same.picture(axes, centre, 7))
    assert (same.picture(axes, centre, 8) != one).any()


@given(poses_behind_the_goal(), floats(-0.5, 0.5), floats(-0.2, 0.2))
def test_the_mast_holds_a_camera_that_looks_down_and_rolls_clockwise(pose, tilt, roll) -> None:
    axes, centre = Mast(tilt=tilt, roll=roll).camera((pose.x, pose.y, pose.theta))
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert axes[2, 2] == pytest.approx(-math.sin(tilt))
    assert math.copysign(1.0, axes[2, 0]) == math.copysign(1.0, -roll) or abs(roll) < 1e-12
    ahead = math.hypot(centre[0] - pose.x, centre[1] - pose.y)
    assert ahead == pytest.approx(math.hypot(0.12, 0.04))


def test_the_base_obeys_late_and_pulls_to_the_left() -> None:
    robot = Robot((0.0, 0.0, 0.0))
    robot.drive(0.2, 0.0, DEAD_TIME)
    assert robot.place == (0.0, 0.0, 0.0)
    robot.drive(0.2, 0.0, 10.0)
    # Less than 10 s by the lag; a larger right wheel turns to the left.
    assert robot.place[2] == pytest.approx(0.2 * (RIGHT_WHEEL - 1.0) / TRACK * 9.88, rel=0.01)
    assert robot.place[0] == pytest.approx(1.98, rel=0.01)


@given(poses_behind_the_goal())
def test_true_bearings_are_not_wrong_and_others_are(pose: Pose) -> None:
    place, true = (pose.x, pose.y, pose.theta), Bearings.from_pose(pose)
    for off, seconds in ((0.0, 0.0), (9.0, 0.0), (-11.0, 0.1), (180.0, 0.1)):
        bearings = true.current + math.radians(off), true.desired
        for measured in (bearings, (true.current, true.desired + math.radians(off))):
            moments = [Moment(place, measured, True), Moment(place, measured, False)]
            assert wrong_geometry_s(moments, CENTRED, 0.1) == seconds


def test_a_mast_that_looks_left_has_the_goal_to_its_right() -> None:
    left, behind = Mast(ahead=0.0, aside=0.0, yaw=0.3), (0.0, -2.0, GOAL[2])
    assert left.camera(GOAL)[0][0, 2] == pytest.approx(-math.sin(0.3))
    for bearings, seconds in (((0.3, 0.3 - math.pi), 0.0), ((0.0, math.pi), 0.1)):
        assert wrong_geometry_s([Moment(behind, bearings, True)], left, 0.1) == seconds


def test_excursion_is_the_largest_distance_over_the_first() -> None:
    places = [(0.0, -2.0, 1.0), (1.5, -2.0, 1.0), (0.0, 0.0, 1.0)]
    assert excursion([Moment(place, None, True) for place in places]) == 1.25
