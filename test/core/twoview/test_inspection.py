"""Two small photographs, of which descriptors tell few matches."""

import math

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.tracking.matchers.sift import SIFT
from visual_servo_epipolar.core.tracking.matching import desired_view, match
from visual_servo_epipolar.core.twoview.inspection import inspect
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings

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
