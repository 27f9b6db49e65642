"""Measurement: heading, bearings, D and margins of one observation, with their deviations."""

from dataclasses import dataclass, field
import math

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.twoview.estimator import UNKNOWN_COVARIANCE

UNBOUNDED = (math.inf, math.inf)


@dataclass(frozen=True, eq=False)
class Measurement:
    """
    What one observation tells about the goal.

    Angles are in rad; times ``focal`` [px] they are pixels at the image centre. ``bearings`` is
    None where no estimate passed the validation gates, and ``reason`` says why. They are those of
    the cameras; where the camera does not sit on the axle they become those of the axle, and
    ``camera_bearings`` keeps the others. ``difference`` is D of eq. (23) at unit focal length,
    averaged over the features, ``difference_deviation`` its noise, ``difference_slope`` what a
    metre ahead adds to it, where a memory of views gives that; ``feature_error`` the median angle
    between current and desired features [rad]; ``parallax`` the angle that the best rotation
    leaves unexplained [rad]; ``heading_error`` [rad], left positive, comes from the bearings where
    there are any, else from that rotation, whose own is ``rotation_heading``. ``deviation`` is the
    larger one of psi and phi [rad], ``covariance`` that of both, shape (2, 2) [rad^2], ``jump``
    the change of tilt and roll between the views [rad]; ``view_margins`` is how far the robot may
    turn to the left and to the right before the features run out of the image [rad], by what a
    head can reach, and ``present_margins`` before they do so where the head is now; ``offset`` is
    where a memory of views has the camera, right and ahead of the goal's [m], None without one,
    with its deviation and that of the heading; ``noise_px`` the deviation of a tracked coordinate
    [px] as the residuals show it. ``rivals`` are the bearings, of either sign, of both geometries
    that fit before a plane, () where one is left: only motion tells them apart; ``bearings`` are
    then those that follow the last ones. ``remembered`` says that the bearings are those of a
    memory of views; ``carried`` that it is a measurement by it alone, where too few features are
    seen for two.
    """

    stamp_ns: int
    features: int
    focal: float
    noise_px: float
    bearings: Bearings | None = None
    camera_bearings: Bearings | None = None
    deviation: float = math.nan
    covariance: FloatArray = field(default_factory=lambda: UNKNOWN_COVARIANCE)
    jump: float = 0.0
    confidence: float = 0.0
    inliers: int = 0
    parallax: float = math.nan
    heading_error: float = math.nan
    rotation_heading: float = math.nan
    difference: float = math.nan
    difference_deviation: float = math.nan
    difference_slope: float = math.nan
    feature_error: float = math.nan
    view_margins: tuple[float, float] = UNBOUNDED
    present_margins: tuple[float, float] = UNBOUNDED
    offset: tuple[float, float] | None = None
    offset_deviation: float = math.nan
    heading_deviation: float = math.nan
    rivals: tuple[Bearings, ...] = ()
    remembered: bool = False
    carried: bool = False
    reason: str = ''

    @property
    def seen_bearings(self) -> Bearings | None:
        """The bearings of the cameras, which images show."""
        return self.camera_bearings or self.bearings

    def is_untrusted(self, near_parallax: float) -> bool:
        """Return whether no bearings are trusted, and the goal is not near or D unknown."""
        if self.bearings is not None:  # facing far away no feature counts in D
            return False
        return self.parallax > near_parallax or not math.isfinite(self.difference)

    @property
    def noise(self) -> float:
        """Deviation of the angle of a ray at the image centre [rad], as the residuals show it."""
        return self.noise_px / self.focal

    @property
    def parallax_px(self) -> float:
        """Parallax in pixels at the image centre."""
        return self.parallax * self.focal
