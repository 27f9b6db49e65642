"""
Two lenses in one camera, back to back: each has a centre of its own, and sees one side.

What comes out is one image, of two fisheyes or stitched: of what lies ahead by the lens in front,
of what lies behind by the other, with a seam where they meet. A stitcher takes both for one
centre, and so does every ``CameraModel``: near things differ by it.
"""

from dataclasses import dataclass

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.rigs.rig import Joints
from visual_servo_epipolar.core.settings import setting, Settings
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.mounts.fixed import fixed_rig, FixedRig
from visual_servo_epipolar.simulation.mounts.simulated_rig import CameraPose, LensPlacement


@dataclass(frozen=True, kw_only=True)
class LensSettings(Settings):
    """Two lenses back to back: how far apart they are, and how the one behind is turned."""

    lens_baseline: float = setting(
        0.1,
        'Distance between the centres of both lenses [m]',
        low=0.0,
        high=0.5,
        read_only=True,
    )
    lens_rotation: tuple[float, float, float] = setting(
        (0.0, 0.0, 0.0),
        'Turn of the lens behind, about right, down and ahead [rad]',
        read_only=True,
    )


@dataclass(frozen=True, kw_only=True)
class TwoLensSettings(LensSettings, CameraSettings):
    """A camera of two lenses, whose mount is where the middle between them is."""


@dataclass(frozen=True, slots=True)
class TwoLensRig:
    """A camera of two ``lenses`` on a mount, which is where the middle between them is."""

    fixed: FixedRig
    lenses: tuple[LensPlacement, LensPlacement]

    @property
    def camera(self) -> CameraModel:
        """The camera, for which both centres are one."""
        return self.fixed.camera

    @property
    def views(self) -> tuple['TwoLensRig']:
        """The rig as it is, alone."""
        return (self,)

    def turned(self, joints: Joints) -> 'TwoLensRig':
        """Return the rig as it is: no joint turns it."""
        return self

    def camera_pose(self, pose: Pose, frame: int | None = None) -> CameraPose:
        """Return where the middle between both centres is."""
        return self.fixed.camera_pose(pose, frame)


def two_lens_rig(settings: TwoLensSettings) -> TwoLensRig:
    """Return the rig that ``settings`` describe."""
    half = 0.5 * settings.lens_baseline
    return TwoLensRig(
        fixed_rig(settings),
        (
            LensPlacement(1, (0.0, 0.0, half)),
            LensPlacement(-1, (0.0, 0.0, -half), settings.lens_rotation),
        ),
    )
