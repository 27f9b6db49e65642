"""Free floor: where in a room a robot can stand, clear of walls and furniture."""

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.simulation.mounts.simulated_rig import SimulatedRig
from visual_servo_epipolar.simulation.rendering.surfaces import Scene

CLEARANCE = 0.3  # from the middle of the axle to the farthest corner of a Pioneer 3-DX [m]
HEADROOM = 0.2  # above the camera: what hangs higher is no obstacle [m]
LEVEL = 1e-9


class Ground:
    """
    The floor plan of a scene, for a robot with a camera on it.

    The floor is the lowest level surface of the room; of furniture, each level surface of a body
    that reaches down to the robot is in the way.
    """

    def __init__(self, scene: Scene, rig: SimulatedRig) -> None:
        self._rig = rig
        height = float(rig.camera_pose(DESIRED_POSE).centre[2])
        level = np.ptp(scene.corners[..., 2], axis=1) < LEVEL
        of_room = scene.bodies == 0
        floors = scene.corners[level & of_room]
        self._floors = floors[floors[:, 0, 2] < height]
        lowest = np.array(
            [scene.corners[scene.bodies == k][..., 2].min() for k in scene.bodies.tolist()]
        )
        reaches_down = lowest < height + HEADROOM
        self._obstacles = scene.corners[level & ~of_room & reaches_down]

    def is_free(self, pose: Pose) -> bool:
        """Return whether the robot and its camera can be at ``pose``."""
        places = np.array([[pose.x, pose.y], self._rig.camera_pose(pose).centre[:2]])
        on_floor = (inside(places, self._floors) >= CLEARANCE).any(axis=1)
        clear = (inside(places, self._obstacles) <= -CLEARANCE).all(axis=1)
        return bool((on_floor & clear).all())


def inside(places: FloatArray, rectangles: FloatArray) -> FloatArray:
    """
    Return how deep ``places`` lie in level rectangles [m]; outside, minus the distance.

    Parameters
    ----------
    places : array, shape (N, 2)
        On the floor [m].
    rectangles : array, shape (M, 4, 3)
        Corners, in order around.

    Returns
    -------
    array, shape (N, M)

    """
    origin = rectangles[:, 0, :2]
    depths = []
    for corner in (1, 3):
        edge = rectangles[:, corner, :2] - origin
        length = np.linalg.norm(edge, axis=1)
        along = ((places[:, None] - origin) * edge).sum(axis=2) / length
        depths.append(np.minimum(along, length - along))
    depth = np.minimum(*depths)
    away = np.hypot(*(np.minimum(item, 0.0) for item in depths))
    return np.asarray(np.where(depth < 0.0, -away, depth))
