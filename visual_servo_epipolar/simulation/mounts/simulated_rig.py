"""Camera rig: which camera a robot carries, and where it is when the robot is at a pose."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.rigs.rig import Joints


class CameraPose(NamedTuple):
    """A camera in the world: axes right, down, forward as columns, (3, 3); centre, (3,) [m]."""

    R_world_camera: FloatArray
    centre: FloatArray


class LensPlacement(NamedTuple):
    """
    One lens of a camera: the ``side`` it sees, 1 ahead, -1 behind, 0 both; where its centre is.

    ``centre`` [m] and ``turn`` [rad], about right, down and ahead, are those of its own axes in
    axes of the camera.
    """

    side: int = 0
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def R_camera_lens(self) -> FloatArray:
        """Axes of the lens in those of the camera, as columns, (3, 3)."""
        return np.asarray(cv2.Rodrigues(np.array(self.turn))[0])

    def shows(self, vectors: FloatArray) -> BoolArray:
        """Return which ``vectors``, shape (..., 3), in its own axes, are on its side: (...)."""
        ahead = vectors[..., 2] >= 0.0
        return np.asarray(ahead if self.side > 0 else ~ahead) | (self.side == 0)

    def pose(self, camera: CameraPose) -> CameraPose:
        """Return where it is on a camera at that pose."""
        axes = camera.R_world_camera
        return CameraPose(axes @ self.R_camera_lens, camera.centre + axes @ np.array(self.centre))


ONE_LENS = (LensPlacement(),)


def lenses_of(rig: 'SimulatedRig') -> tuple[LensPlacement, ...]:
    """Return the lenses of a rig that has several, as its ``lenses``; else the one it has."""
    return getattr(rig, 'lenses', ONE_LENS)


class SimulatedRig(Protocol):
    """What holds the camera on the robot; all that it does follows from pose and frame."""

    @property
    def camera(self) -> CameraModel:
        """The true camera model."""
        ...

    @property
    def views(self) -> Sequence['SimulatedRig']:
        """The rig as joints may turn it, closely enough that nothing is seen in between alone."""
        ...

    def turned(self, joints: Joints) -> 'SimulatedRig':
        """Return the rig with the joints of its head at these angles; at rest they are zero."""
        ...

    def camera_pose(self, pose: Pose, frame: int | None = None) -> CameraPose:
        """
        Return where the camera is with the robot at ``pose`` in ``frame``: -1, 0, 1, ...

        Frame -1 is that of the photograph, with joints at rest; None is a level floor, which
        shakes nothing.
        """
        ...
