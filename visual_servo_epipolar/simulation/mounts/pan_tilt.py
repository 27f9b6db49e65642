"""Camera on a pan-tilt head: where it is when the head is turned."""

from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.rigs.rig import AT_REST, Joints
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount, floor_jitter, on_bumps
from visual_servo_epipolar.simulation.mounts.sensor import DESIRED_FRAME
from visual_servo_epipolar.simulation.mounts.simulated_head import HeadSettings
from visual_servo_epipolar.simulation.mounts.simulated_rig import CameraPose

VIEWS = 15  # from end to end of a pan joint


@dataclass(frozen=True, kw_only=True)
class PanTiltSettings(HeadSettings, CameraSettings):
    """A camera that a head turns, and the head, with its pan axis at the mount."""


@dataclass(frozen=True, slots=True)
class PanTiltRig:
    """
    A camera on a head, the pan axis at ``mount``; ``joints`` are the true angles [rad].

    The photograph is taken at ``rest``: where encoders that are off by an offset read zero.
    """

    camera: CameraModel
    mount: CameraMount = CameraMount()
    jitter: float = 0.0
    seed: int = 0
    bumps: float = 0.0
    lever: float = 0.0
    pan_limit: float = 0.0
    rest: Joints = AT_REST
    joints: Joints | None = None

    @property
    def views(self) -> tuple['PanTiltRig', ...]:
        """The rig at rest, and panned from end to end."""
        pans = np.linspace(-self.pan_limit, self.pan_limit, VIEWS).tolist()
        return self, *(self.turned(Joints(pan)) for pan in pans)

    def turned(self, joints: Joints) -> 'PanTiltRig':
        """Return the rig with these joints."""
        return replace(self, joints=joints)

    def camera_pose(self, pose: Pose, frame: int | None = None) -> CameraPose:
        """Return where the camera is; joints are at rest unless they were turned."""
        joints = self.rest if frame == DESIRED_FRAME or self.joints is None else self.joints
        tilt, roll = (0.0, 0.0) if frame is None else floor_jitter(self.jitter, self.seed, frame)
        panned = Pose(pose.x, pose.y, pose.theta + joints.pan)
        axes = self.mount.R_world_camera(panned, tilt=joints.tilt + tilt, roll=roll)
        looks = panned.theta + self.mount.yaw
        lever = self.lever * np.array([math.cos(looks), math.sin(looks), 0.0])
        camera = CameraPose(axes, self.mount.centre(pose) + lever)
        return on_bumps(camera, pose, 0.0 if frame is None else self.bumps, self.seed)


def pan_tilt_rig(settings: PanTiltSettings) -> PanTiltRig:
    """Return the rig that ``settings`` describe."""
    return PanTiltRig(
        settings.camera,
        settings.mount,
        settings.jitter,
        settings.seed,
        settings.bumps,
        settings.head_lever,
        settings.head_pan_limit,
        Joints(-settings.head_encoder_offset),
    )
