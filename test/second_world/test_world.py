"""A second simulator, of other code: robots arrive in it, and its judge knows a wrong geometry."""

from collections.abc import Iterator
from dataclasses import dataclass
import math

import cv2
from hypothesis import given
import pytest
from second_world.robot import (
    excursion,
    GOAL,
    Mast,
    Moment,
    Place,
    Robot,
    wrong_geometry_s,
)
from second_world.scene import Lens, Painter
from strategies import poses_behind_the_goal

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

CENTRED = Mast(ahead=0.0, aside=0.0)


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
