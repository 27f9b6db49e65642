"""Planar motion with a camera that is nearly upright: tilt, roll and floor jitter have priors."""

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.rays import image_axes
from visual_servo_epipolar.core.twoview import tilted_planar, wrong_lens
from visual_servo_epipolar.core.twoview.estimator import Estimate, Prior
from visual_servo_epipolar.core.twoview.hypotheses import rays_of
from visual_servo_epipolar.core.twoview.planar import from_last_bearings, PlanarModel
from visual_servo_epipolar.core.twoview.search import search
from visual_servo_epipolar.core.twoview.tilted_planar import plausible_matches

CALIBRATED = PlanarModel(
    tilted_planar.matrices,
    tilted_planar.attitude_prior,
    tilted_planar.conclude,
)
UNCALIBRATED = PlanarModel(
    wrong_lens.matrices,
    wrong_lens.lens_prior,
    wrong_lens.conclude,
    image_axes,
)


def soft_planar(
    current: FloatArray,
    desired: FloatArray,
    *,
    noise: FloatArray | float,
    prior: Prior,
    rng: np.random.Generator,
) -> Estimate:
    """
    Estimate (psi, phi) together with tilt and roll, and what the floor changed of them since.

    Two-point hypotheses on levelled rays, the best of different modes refined by Gauss-Newton on
    six parameters with ``prior.attitude``, the lowest truncated cost wins. Where
    ``prior.bearings`` fit at once nothing else is looked for. A camera whose attitude is not known
    yet costs several tilts to try. ``rng`` is not needed.

    Where ``prior.lens`` is not calibrated, what is wrong with the camera matrix still is estimated
    as well: nine parameters, and hypotheses for several focal lengths.

    Raises
    ------
    DegenerateGeometryError
        With fewer than five matches, or all of them on the horizon, or no baseline at all.

    """
    del rng
    model = CALIBRATED if prior.lens.calibrated else UNCALIBRATED
    rays = rays_of(current, desired, noise)
    matches = plausible_matches(rays, prior)
    estimate = from_last_bearings(model, rays, matches, prior)
    return estimate or search(model, rays, matches, prior)
