"""
Two lenses in one camera, back to back: each has a centre of its own, and sees one side.

What comes out is one image, of two fisheyes or stitched: of what lies ahead by the lens in front,
of what lies behind by the other, with a seam where they meet. A stitcher takes both for one
centre, and so does every ``CameraModel``: near things differ by it.
"""

from dataclasses import dataclass, replace

from visual_servo_epipolar.core.settings import fixed, internal, Settings
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.mounts.mounting import FixedRig
from visual_servo_epipolar.simulation.mounts.simulated_rig import LensPlacement


@dataclass(frozen=True, kw_only=True)
class LensSettings(Settings):
    """Two lenses back to back: how far apart they are, and how the one behind is turned."""

    lens_baseline: float = fixed(
        0.1, 'Distance between the centres of both lenses [m]', low=0.0, high=0.5
    )
    lens_rotation: tuple[float, float, float] = internal(
        (0.0, 0.0, 0.0), 'Turn of the lens behind, about right, down and ahead [rad]'
    )


@dataclass(frozen=True, kw_only=True)
class TwoLensSettings(LensSettings, CameraSettings):
    """A camera of two lenses, whose mount is where the middle between them is."""


def two_lens_rig(settings: TwoLensSettings) -> FixedRig:
    """Return the rig that ``settings`` describe."""
    half = 0.5 * settings.lens_baseline
    ahead = LensPlacement(1, (0.0, 0.0, half))
    behind = LensPlacement(-1, (0.0, 0.0, -half), settings.lens_rotation)
    return replace(settings.fixed_rig(), lenses=(ahead, behind))
