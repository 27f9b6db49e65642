"""Two small photographs, of which descriptors tell few matches."""

import math

import numpy as np
import pytest
from strategies import blurred, seen_from

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.tracking.matchers.sift import SIFT
from visual_servo_epipolar.core.tracking.matching import desired_view, match
from visual_servo_epipolar.core.twoview.inspection import inspect, Inspection, judged
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

POSE = Pose.from_start(0.8, -3.0, 10.0)
WORLD = CameraSimulator(
    CameraSettings(width=320, height=240, focal_length=160.0, principal_u=159.5, principal_v=119.5)
)


def test_what_descriptors_do_not_tell_is_searched_for_beside_what_they_do() -> None:
    desired, current = WORLD.photograph(), WORLD.capture(POSE, 0)
    found = inspect(desired, current, WORLD.camera, WORLD.camera, PerceptionSettings())
    described = match(desired_view(desired, SIFT), current)
    assert len(found.current) > 2 * len(described.indices)  # 228 beside 50
    truth = Bearings.from_pose(POSE)
    assert found.trusted
    assert abs(math.degrees(found.bearing_current - truth.current)) < 1.0
    assert abs(math.degrees(found.bearing_desired - truth.desired)) < 1.0


def test_patches_that_overlap_make_bearings_less_certain_than_as_many_others() -> None:
    settings = PerceptionSettings()
    found = inspect(
        WORLD.photograph(), WORLD.capture(POSE, 0), WORLD.camera, WORLD.camera, settings
    )
    rays = WORLD.camera.rays(found.current), WORLD.camera.rays(found.desired)
    apart, _ = judged(Observation(0, *rays, WORLD.camera.focal), settings)
    assert found.deviation > 1.1 * apart.deviation


FOCAL, NOISE_PX = 400.0, 0.2
START, HEIGHT = (0.8, -1.5, 10.0), 0.3
OVER = np.diag([-1.0, -1.0, 1.0])
TOLD = {'camera_tilt_deviation': 0.02, 'camera_roll_deviation': 0.02}


def scene(height: float) -> np.ndarray:
    """Return points on a floor, ``height`` [m] below the camera, and on walls all over it."""
    rng = np.random.default_rng(2)
    floor = rng.uniform([-2.0, height, 1.0], [2.0, height, 5.0], (80, 3))
    walls = rng.uniform([-3.0, -2.2, 4.0], [3.0, height, 8.0], (120, 3))
    return np.concatenate([floor, walls])


def inspected(points: np.ndarray, turn: np.ndarray, **settings: float) -> Inspection:
    views = (seen_from(Pose.from_start(*START), points), points)
    rng = np.random.default_rng(0)
    rays = (blurred(normalised(view) @ turn, NOISE_PX / FOCAL, rng) for view in views)
    return judged(Observation(0, *rays, FOCAL), ServoSettings(**settings))[0]


def test_both_upside_down_are_named_where_the_floor_is_seen() -> None:
    upright, over = (inspected(scene(HEIGHT), turn) for turn in (np.eye(3), OVER))
    assert upright.trusted and np.degrees(upright.rotation) == pytest.approx(START[2], abs=0.3)
    assert not over.trusted and over.reason.startswith('both photographs may be upside down')


@pytest.mark.parametrize('turn', [np.eye(3), OVER], ids=['upright', 'over'])
def test_a_room_that_is_as_near_above_as_below_tells_nothing(turn: np.ndarray) -> None:
    walls = np.random.default_rng(4).uniform([-3.0, -1.5, 3.0], [3.0, 1.5, 7.0], (200, 3))
    assert inspected(walls, turn).trusted


def test_a_mount_that_is_told_is_believed() -> None:
    assert inspected(scene(HEIGHT), OVER, **TOLD).trusted
