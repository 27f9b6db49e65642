"""What the camera of a benchmark shows: a cycle of images, so that no jump ends the tracks."""

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator

START = Pose.from_start(0.3, -2.2, 0.0)
VIEWS, STRIDE = 30, 0.01  # images on the way to the goal, and metres between two


def views(simulator: CameraSimulator) -> list[Image]:
    """Return images, shape (H, W), on a way ahead and back again: a cycle."""
    ahead = [
        simulator.capture(Pose(START.x, START.y + STRIDE * number, START.theta), number)
        for number in range(VIEWS)
    ]
    return ahead + ahead[-2:0:-1]
