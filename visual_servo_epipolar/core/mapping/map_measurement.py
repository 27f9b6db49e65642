"""Map measurement: the localization of a view in the terms of a measurement."""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.mapping.adjustment.window import HEADING
from visual_servo_epipolar.core.mapping.localization import MapLocalization

LEAST_AHEAD = 0.1  # cosine off the axis, below which a feature has no image point


@dataclass(frozen=True, slots=True, eq=False)
class MapMeasurement:
    """
    Localization of a view in the terms of a measurement.

    ``bearings`` of the cameras, None at the goal itself, with their ``covariance``, (2, 2)
    [rad^2], which grows without bound towards it; ``lateral`` and ``longitudinal`` offset (right,
    ahead) [m] and ``heading_error`` [rad], which are defined there as well, with deviations;
    ``own`` are those parts of the three deviations that average out over views. ``depth_ratio`` is
    the offset along the axis over the median depth, which needs no scale. ``difference`` is D at
    unit focal length as the offset makes it, ``difference_slope`` its slope along the axis [1/m];
    ``parallax`` [rad] that of the median feature; ``inliers`` counts features that agree.
    ``view_rays``, (M, 3), is where a view that shows none of the photograph's features would see
    them; None where it does.
    """

    bearings: Bearings | None
    covariance: FloatArray
    deviation: float
    lateral: float
    lateral_deviation: float
    longitudinal: float
    longitudinal_deviation: float
    heading_error: float
    heading_deviation: float
    own: tuple[float, float, float]
    depth_ratio: float
    depth_ratio_deviation: float
    parallax: float
    difference: float
    difference_deviation: float
    difference_slope: float
    inliers: int
    view_rays: FloatArray | None = None


def map_measurement_of(said: MapLocalization, slope: float) -> MapMeasurement:
    """Return the measurement by a localization; D has a ``slope`` by the longitudinal offset."""
    covariance = said.bearings_covariance
    own = said.own.ravel()[:: len(said.own) + 1][: HEADING + 1].tolist()
    lateral, longitudinal, heading_error = said.pose[: HEADING + 1].tolist()
    longitudinal_deviation = said.longitudinal_deviation
    return MapMeasurement(
        said.bearings,
        covariance,
        math.sqrt(max(covariance[0, 0], covariance[1, 1])),
        lateral,
        said.lateral_deviation,
        longitudinal,
        longitudinal_deviation,
        heading_error,
        said.heading_deviation,
        (math.sqrt(own[0]), math.sqrt(own[1]), math.sqrt(own[2])),
        longitudinal / said.depth,
        longitudinal_deviation / said.depth,
        said.parallax,
        slope * longitudinal,
        slope * longitudinal_deviation,
        slope,
        int(np.count_nonzero(said.inliers)),
    )


def difference_slope(
    desired: FloatArray, inverse_depth: FloatArray, *, wide: bool = False
) -> float:
    """Return dD/dy at the goal [1/m], averaged over features ahead: positive past the goal."""
    z = desired[:, 2]
    square = 1.0 - z * z
    if wide:  # D counts 2 (1 - z)
        return float(np.mean(2.0 * square * inverse_depth)) if len(z) else math.nan
    ahead = z > LEAST_AHEAD
    if not ahead.any():
        return math.nan
    # |p|^2 = (X^2 + Y^2) / (Z - y)^2 grows by 2 |p|^2 / Z, and Z = z / nearness.
    return float(np.mean(2.0 * square[ahead] * inverse_depth[ahead] / z[ahead] ** 3))
