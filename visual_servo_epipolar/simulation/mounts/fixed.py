"""Fixed rig: a camera screwed to the robot, which an uneven floor tilts and rolls."""

from dataclasses import dataclass

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.rigs.rig import Joints
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount, floor_jitter
from visual_servo_epipolar.simulation.mounts.simulated_rig import (
    CameraPose,
    LensPlacement,
    ONE_LENS,
)


@dataclass(frozen=True, slots=True)
class FixedRig:
    """
    A camera on its mount; ``jitter`` is the deviation [rad] of what the floor adds, seeded.

    Where it has several ``lenses``, their placements are on the camera.
    """

    camera: CameraModel
    mount: CameraMount = CameraMount()
    jitter: float = 0.0
    seed: int = 0
    lenses: tuple[LensPlacement, ...] = ONE_LENS

    @property
    def views(self) -> tuple['FixedRig']:
        """The rig as it is, alone."""
        return (self,)

    def turned(self, joints: Joints) -> 'FixedRig':
        """Return the rig as it is: no joint turns it."""
        return self

    def camera_pose(self, pose: Pose, frame: int | None = None) -> CameraPose:
        """Return where the camera is with the robot at ``pose``; frame None is a level floor."""
        tilt, roll = (0.0, 0.0) if frame is None else floor_jitter(self.jitter, self.seed, frame)
        axes = self.mount.R_world_camera(pose, tilt=tilt, roll=roll)
        return CameraPose(axes, self.mount.centre(pose))


def fixed_rig(settings: CameraSettings) -> FixedRig:
    """Return the rig that ``settings`` describe."""
    return FixedRig(settings.camera, settings.mount, settings.jitter, settings.seed)
