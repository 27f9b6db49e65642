"""
Planar motion with a camera that is nearly upright: tilt, roll and floor jitter have priors.

Refined from the last bearings; where there are none, or none that fit, the geometry is searched.
A camera that may be mounted any way is most likely level, or as estimated before: hypotheses
by pairs of matches, which need the attitude nearly, come first. Those by OpenCV's USAC, which need
nothing, are accepted where the matches support them by more than chance.

USAC gives an essential matrix without any vertical. In a planar motion the vertical n of
the desired camera is across the baseline and is the axis of the rotation: n . t = 0, R n = n. What
a pair leaves open, as a pure translation does, the prior of the attitude closes.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, packed
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.epipolar import Bearings, decomposed, MOTION_PARAMETERS
from visual_servo_epipolar.core.geometry.motion import HALF_PI
from visual_servo_epipolar.core.geometry.rays import image_axes, rotation_level_camera
from visual_servo_epipolar.core.geometry.rotation import fit_rotation, headings
from visual_servo_epipolar.core.tracking.robust_geometry import essential_matrices
from visual_servo_epipolar.core.twoview import tilted_planar, wrong_lens
from visual_servo_epipolar.core.twoview.estimator import Attitude, COLD_DEVIATION, Estimate, Prior
from visual_servo_epipolar.core.twoview.hypotheses import (
    ALTERNATIVE_COST,
    best_modes,
    choose_mode,
    Rays,
    rays_of,
    remaining_rays,
    scores,
    SEPARATION,
    two_point_hypotheses,
    WORST,
)
from visual_servo_epipolar.core.twoview.planar import (
    concluded,
    from_last_bearings,
    JITTER_SHARE,
    PlanarModel,
    undetermined,
    widening,
    with_bearings,
)
from visual_servo_epipolar.core.twoview.refinement import (
    Fit,
    refined,
)
from visual_servo_epipolar.core.twoview.tilted_planar import (
    exchanged_on_plane,
    in_front_of,
    levelled,
    PHI,
    plausible_matches,
    PSI,
    ROLL,
    TILT,
    TILT_JUMP,
)
from visual_servo_epipolar.core.twoview.wrong_lens import starts_by_focal_lengths

POOR = 0.4  # part of the worst possible cost above which few matches agree
COLD = math.radians(0.3)  # above this deviation of the tilt, hypotheses are made for several tilts
GENERAL = math.radians(2.5)  # above it tilts to try would be too many
TILTS = np.linspace(-1.0, 1.0, 9)  # of those, in deviations of the prior
PAIRS = 60  # for each attitude that is tried
LEVEL_MODES = 6
NO_JUMP = np.zeros(1)
JUMPS = np.array([-3.2, -1.6, 0.0, 1.6, 3.2])  # of tilt between the views, in jitters
PLANARITY = 0.004  # how far a good one leaves n . t and R n - n from zero
ROUGHNESS = 6.0  # of hypotheses by USAC, or of a focal length beside the true one, in noises

Refine = Callable[[PlanarModel, Rays, Prior], Fit]


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


@dataclass(frozen=True, slots=True)
class _Found:
    """The best fit to all N matches, those it was made of, its ``cost``, what else fits."""

    fit: Fit
    matches: BoolArray
    prior: Prior
    cost: float
    alternative: Bearings | None


def search(model: PlanarModel, rays: Rays, matches: BoolArray, prior: Prior) -> Estimate:
    """
    Return the best estimate of one pair of views, of which the plausible ``matches`` are (N,).

    Raises
    ------
    DegenerateGeometryError
        With too few matches, or where they leave the geometry open.

    """
    found = _best_found(model, rays, matches, prior)
    estimate = concluded(model, rays, found.matches, found.fit, found.prior)
    return replace(estimate, alternative=found.alternative)


def _best_found(model: PlanarModel, rays: Rays, matches: BoolArray, prior: Prior) -> _Found:
    mount = prior.mount or prior.attitude
    anyhow = replace(prior, attitude=mount, bearings=None)
    everyone = np.ones_like(matches)
    try:
        found = _found(model, rays, matches, _likely(prior), _by_pairs)
    except DegenerateGeometryError:
        if not is_general(mount):
            raise
        return _found(model, rays, everyone, anyhow, _by_essentials)
    is_poor = found.cost > POOR * WORST * rays.matches
    if not (is_general(mount) and (is_cold(prior.attitude) or is_poor)):
        return found
    try:
        other = _found(model, rays, everyone, anyhow, _by_essentials)
    except DegenerateGeometryError:
        return found
    return other if other.cost < found.cost - ALTERNATIVE_COST else found


def _likely(prior: Prior) -> Prior:
    """Return the ``prior`` with its attitude near the mean, if a mount may be any."""
    attitude = prior.attitude
    if not is_general(attitude):
        return prior
    nearer = replace(
        attitude,
        tilt_deviation=min(attitude.tilt_deviation, COLD_DEVIATION),
        roll_deviation=min(attitude.roll_deviation, COLD_DEVIATION),
    )
    return replace(prior, attitude=nearer)


def _found(
    model: PlanarModel, rays: Rays, matches: BoolArray, prior: Prior, refine: Refine
) -> _Found:
    matches = matches & plausible_matches(rays, prior)
    remaining = remaining_rays(rays, matches, MOTION_PARAMETERS)
    fits = refine(model, remaining, prior)
    mode, alternative = choose_mode(fits.parameters[:, : PHI + 1], fits.costs, prior)
    if alternative is None and not prior.decided and prior.lens.calibrated:
        alternative = _twin(model, remaining, fits.take(mode), prior)
    cost = float(fits.costs[mode]) + WORST * (rays.matches - remaining.matches)
    return _Found(fits.take(mode).of_all(matches), matches, prior, cost, alternative)


def _twin(model: PlanarModel, rays: Rays, fit: Fit, prior: Prior) -> Bearings | None:
    """Return the other geometry that a plane fits, where hypotheses have missed it; or None."""
    start = exchanged_on_plane(rays, fit)
    if start is None:
        return None
    twin = refined(start, model.problem(rays, prior), widening(rays, prior))
    # Of one plane both have the same residuals, across two directions: sums of N squares.
    by_chance = 3.0 * math.sqrt(4.0 * rays.matches)
    if not twin.costs < fit.costs + max(ALTERNATIVE_COST, by_chance):
        return None
    psi, phi = twin.parameters[: PHI + 1].tolist()
    apart = np.abs(np.sin(twin.parameters[: PHI + 1] - fit.parameters[: PHI + 1])).max()
    return Bearings(psi, phi) if apart > math.sin(SEPARATION) else None


def _by_pairs(model: PlanarModel, rays: Rays, prior: Prior) -> Fit:
    """Return the refined best modes of two-point hypotheses, and of the last bearings."""
    cold = is_cold(prior.attitude)
    with_jumps = partial(start_parameters, attitude=prior.attitude, jumps=JUMPS)
    first = partial(with_jumps, jumps=NO_JUMP) if cold else with_jumps
    fits = _refined_hypotheses(model, rays, prior, first)
    # A jump of the tilt may be more than hypotheses bear.
    is_poor = fits.costs.min() > POOR * WORST * rays.matches
    return _refined_hypotheses(model, rays, prior, with_jumps) if cold and is_poor else fits


def _by_essentials(model: PlanarModel, rays: Rays, prior: Prior) -> Fit:
    """Return the refined best modes of hypotheses by USAC."""
    hypotheses = partial(general_start_parameters, attitude=prior.attitude)
    return _refined_hypotheses(model, rays, prior, hypotheses, roughness=ROUGHNESS)


def _refined_hypotheses(
    model: PlanarModel,
    rays: Rays,
    prior: Prior,
    hypotheses: Callable[[Rays], FloatArray],
    roughness: float = 0.0,
) -> Fit:
    problem = model.problem(rays, prior)
    calibrated = prior.lens.calibrated
    starts = hypotheses(rays) if calibrated else starts_by_focal_lengths(rays, prior, hypotheses)
    if prior.bearings is not None:
        starts = np.vstack([starts, with_bearings(problem.prior.mean, prior)])
    if not len(starts):
        raise undetermined()
    least = roughness if calibrated else ROUGHNESS
    fits = refined(starts, problem, max(least, widening(rays, prior)))
    if not calibrated:
        return fits
    # A match that agrees from behind a camera costs as much as one that does not.
    agree = fits.squared <= WORST
    _, in_front = in_front_of(rays, agree, fits.parameters)
    dear = np.where(agree & ~in_front, WORST - fits.squared, 0.0).sum(axis=-1)
    return fits._replace(costs=fits.costs + dear)


def is_cold(attitude: Attitude) -> bool:
    """Return whether the tilt is so little known that several must be tried."""
    return attitude.tilt_deviation > COLD


def is_general(attitude: Attitude) -> bool:
    """Return whether the attitude is so little known that hypotheses must do without."""
    return max(attitude.tilt_deviation, attitude.roll_deviation) > GENERAL


def start_parameters(rays: Rays, attitude: Attitude, jumps: FloatArray) -> FloatArray:
    """
    Return the best hypotheses of different modes as parameters, shape (K, 6).

    ``jumps`` of the tilt between the views are tried, in jitters, and tilts where it is cold.
    """
    tilts = attitude.tilt + (attitude.tilt_deviation * TILTS if is_cold(attitude) else np.zeros(1))
    grid = np.stack(np.meshgrid(tilts, attitude.jitter * jumps), axis=-1).reshape(-1, 2)
    upright = levelled(rays, grid[:, 0], attitude.roll, tilt_jump=grid[:, 1])
    hypotheses = two_point_hypotheses(upright, PAIRS)
    costs = scores(hypotheses, upright.blurred(JITTER_SHARE * attitude.jitter)).ravel()
    each = hypotheses.shape[-1]
    hypotheses = hypotheses.swapaxes(0, 1).reshape(2, -1)
    best = best_modes(hypotheses, costs, LEVEL_MODES, separation=0.5 * SEPARATION)
    start = np.zeros((len(best), 6))
    start[:, [PSI, PHI]] = np.angle(hypotheses[:, best]).T
    start[:, ROLL] = attitude.roll
    start[:, [TILT, TILT_JUMP]] = grid[best // each]
    return start


def general_start_parameters(rays: Rays, attitude: Attitude) -> FloatArray:
    """Return hypotheses by USAC as parameters, shape (K, 6), none where it finds none."""
    # What both cameras see is turned to lie ahead of both: OpenCV has no rays.
    turn = fit_rotation(rays.current, rays.desired).rotation
    pixel = 0.5 * ROUGHNESS * float(rays.mean_noise)
    essential = essential_matrices(rays.current @ turn.T, rays.desired, pixel) @ turn
    return planar_parameters(essential, attitude) if len(essential) else np.empty((0, 6))


def planar_parameters(essential: FloatArray, attitude: Attitude) -> FloatArray:
    """Return the planar motions nearest to ``essential``, shape (K, 3, 3), as (K, 6)."""
    baseline, both = decomposed(essential)
    away = both - np.eye(3)
    spread = baseline[:, :, None] * baseline[:, None] + away.swapaxes(-1, -2) @ away
    values, vectors = np.linalg.eigh(spread / PLANARITY**2 + _prior_form(attitude))
    # One of the two is the other turned by half around the baseline: no vertical is its axis.
    twin = values[..., 0].argmin(axis=0)
    each = np.arange(len(essential))
    vertical, rotation = vectors[twin, each, :, 0], both[twin, each]
    vertical *= np.copysign(1.0, vertical @ _level(attitude)[1])[:, None]
    tilt = np.arcsin(np.clip(vertical[:, 2], -1.0, 1.0))
    roll = np.arctan2(packed(vertical[:, 0]), packed(vertical[:, 1]))
    return _parameters(baseline, rotation, tilt, roll)


def _parameters(
    baseline: FloatArray, rotation: FloatArray, tilt: FloatArray, roll: FloatArray
) -> FloatArray:
    """Return psi, phi, tilt, roll without jumps, shape (K, 6), from t and R in tilted axes."""
    level = np.array([rotation_level_camera(*each) for each in zip(tilt, roll, strict=True)])
    upright = (level @ baseline[..., None])[..., 0]
    turn = level @ rotation @ level.swapaxes(-1, -2)
    start = np.zeros((len(tilt), 6))
    start[:, PSI] = np.arctan2(packed(upright[:, 2]), packed(upright[:, 0]))
    start[:, PHI] = start[:, PSI] - headings(turn) - HALF_PI
    start[:, TILT], start[:, ROLL] = tilt, roll
    return start


def _level(attitude: Attitude) -> FloatArray:
    return rotation_level_camera(attitude.tilt, attitude.roll)


def _prior_form(attitude: Attitude) -> FloatArray:
    """Return the quadratic form of a vertical, shape (3, 3), that the prior of attitude is."""
    right, _, forward = _level(attitude)
    by_roll = np.outer(right, right) / attitude.roll_deviation**2
    return np.asarray(by_roll + np.outer(forward, forward) / attitude.tilt_deviation**2)
