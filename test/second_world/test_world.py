"""A second simulator, of other code: true to its lens and mast, and robots arrive in it."""

from collections.abc import Iterator
from dataclasses import dataclass
import math

import cv2
from hypothesis import given
import numpy as np
import pytest
from second_world.robot import (
    DEAD_TIME,
    excursion,
    GOAL,
    Mast,
    Moment,
    Place,
    RIGHT_WHEEL,
    Robot,
    TRACK,
    wrong_geometry_s,
)
from second_world.scene import Lens, Painter, panel
from strategies import floats, poses_behind_the_goal

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import step
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.core.twoview.observation import observe

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


SEED = 5
WIDE = Lens((640, 480), 550.0, (324.0, 236.5), (-0.12, 0.03, 0.0006, -0.0004))
CAMERA = Camera(640, 480, 550.0, 550.0, 324.0, 236.5, WIDE.coefficients)
PERIOD_NS = 100_000_000
LONGEST = 600  # frames
BRAKING = 6  # frames
LEVEL, DOWN, UP = (
    Mast(tilt=math.radians(tilt), roll=math.radians(roll), yaw=math.radians(yaw))
    for tilt, roll, yaw in ((0.0, 0.0, 0.0), (7.0, 2.0, 0.0), (-12.0, -5.0, 4.0))
)
RIGHT, LEFT = (0.8, -3.2, 6.0), (-1.0, -4.0, -8.0)  # x, y [m], heading error [deg]


@dataclass(frozen=True)
class Drive:
    """How a run ended, by what the servo says and by ground truth."""

    phase: Phase
    reason: str
    place: Place
    moments: list[Moment]


@pytest.fixture(scope='module')
def furnished() -> Iterator[Painter]:
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield Painter(WIDE, SEED)
    cv2.setNumThreads(threads)


def driven(furnished: Painter, mast: Mast, start: tuple[float, float, float]) -> Drive:
    tracker = Tracker(TrackerSettings())
    tracker.set_desired(furnished.picture(*mast.camera(GOAL), 0))
    x, y, heading = start
    robot, state = Robot((x, y, GOAL[2] + math.radians(heading))), ServoState()
    settings, moments, ended = ServoSettings(), [], 0
    for frame in range(1, LONGEST):
        features = tracker.track(furnished.picture(*mast.camera(robot.place), frame))
        state = step(state, observe(features, CAMERA, frame * PERIOD_NS), settings)
        moments.append(moment(robot.place, state))
        robot.drive(state.command.twist.linear, state.command.twist.angular, 1e-9 * PERIOD_NS)
        ended += state.phase.ended
        if ended > BRAKING:
            break
    return Drive(state.phase, state.reason, robot.place, moments)


def moment(place: Place, state: ServoState) -> Moment:
    assert state.measurement is not None
    bearings, twist = state.measurement.bearings, state.command.twist
    measured = None if bearings is None else (bearings.current, bearings.desired)
    return Moment(place, measured, bool(twist.linear or twist.angular))


@pytest.mark.parametrize(
    ('mast', 'start'),
    [
        pytest.param(LEVEL, RIGHT, id='level, from the right', marks=pytest.mark.long),
        pytest.param(LEVEL, LEFT, id='level, from the left', marks=pytest.mark.long),
        pytest.param(DOWN, LEFT, id='7 deg down'),
        pytest.param(UP, RIGHT, id='12 deg up, 4 deg to the left', marks=pytest.mark.long),
    ],
)
def test_the_robot_arrives_and_never_drives_on_a_wrong_geometry(furnished, mast, start) -> None:
    drive = driven(furnished, mast, start)
    assert wrong_geometry_s(drive.moments, mast, 1e-9 * PERIOD_NS) < 1.0
    assert excursion(drive.moments) <= 1.2
    assert drive.phase is Phase.ARRIVED, drive.reason
    x, y, heading = drive.place
    # Measured: 1.2 to 2.2 mm, 0.05 deg.
    assert math.hypot(x, y) < 0.006
    assert abs(heading - GOAL[2]) < math.radians(0.2)
