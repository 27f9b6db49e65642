"""Camera rig: which camera a robot carries, and where it is when the robot is at a pose."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.rigs.rig import Joints


class CameraPose(NamedTuple):
    """A camera in the world: axes right, down, forward as columns, (3, 3); centre, (3,) [m]."""

    R_world_camera: FloatArray
    centre: FloatArray


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
