"""Two photographs, no robot: epipoles, bearings, rotation, and whether to trust them."""

from dataclasses import dataclass, field, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.plausibility import doubtful_tilt
from visual_servo_epipolar.core.errors import DegenerateGeometryError, TrackingError
from visual_servo_epipolar.core.geometry.epipolar import in_pixels, MIN_MATCHES
from visual_servo_epipolar.core.geometry.rays import rotation_level_camera
from visual_servo_epipolar.core.geometry.rotation import fit_rotation
from visual_servo_epipolar.core.reasons import Reason, reason_of
from visual_servo_epipolar.core.tracking.alignment.sampling import float_image, overlap
from visual_servo_epipolar.core.tracking.alignment.template_alignment import (
    Anchor,
    FIRST_ITERATIONS,
)
from visual_servo_epipolar.core.tracking.alignment.warps import Warps
from visual_servo_epipolar.core.tracking.canvas import Canvas, PLANE
from visual_servo_epipolar.core.tracking.matchers.base import Matcher
from visual_servo_epipolar.core.tracking.matchers.sift import SIFT
from visual_servo_epipolar.core.tracking.matching import (
    desired_view,
    DesiredView,
    match,
    Matches,
    warps_of,
)
from visual_servo_epipolar.core.tracking.reacquisition import among_neighbours
from visual_servo_epipolar.core.twoview.estimator import Attitude, Estimate
from visual_servo_epipolar.core.twoview.general_motion import (
    general_motion,
    GeneralFit,
    Motions,
    planar_deviations,
    planar_is_simplest,
    Spread,
    spread_of,
)
from visual_servo_epipolar.core.twoview.hypotheses import rays_of
from visual_servo_epipolar.core.twoview.lens_check import contradicted_by_pair, uncalibrated
from visual_servo_epipolar.core.twoview.memory import fresh_memory
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.perceive import perceive
from visual_servo_epipolar.core.twoview.registry import estimate
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings
from visual_servo_epipolar.core.twoview.validation import (
    outside_mount,
    prior_of,
    rolled_between,
    turned_about,
)

MIN_CORRELATION = 0.75
ENOUGH, ROUNDS = 250, 2  # matches; searches for more among their neighbours
AMONG_NEIGHBOURS = 0.85  # correlation of those, for which no descriptor speaks
MIN_SHARE = 0.5  # of the matches that must agree
PLANAR_SHARE = 0.7  # of the inliers of a general motion that a planar one must explain
REPORTED = math.radians(3.0)  # deviation of tilt or roll beyond which it is not reported
SAME_PLACE_PX = 0.3  # parallax that noise alone makes
LARGEST_DEVIATION = math.radians(1.5)  # of bearings that are trusted: half of what is wrong
LARGEST_TURN_DEVIATION = math.radians(2.0)  # of a heading that is reported
NEAR_PX = 2.5  # parallax below which a baseline may be missing altogether
UNLEVEL = 2.0  # ratio of deviations beyond which the ground plane costs too much
VERTICAL = 0.5  # share of what an estimated ground plane changes that counts as its deviation
GENERAL = 'general epipolar geometry'
FAR = math.radians(15.0)  # between two answers
OFF_HORIZON = math.radians(4.0)  # by which a feature is above or below it: three of a level mount
OFF_BASELINE = 0.1  # sine of the angle from it that a depth needs
# Of pairs of features, one above the horizon and one below, those where the upper one is nearer:
# of 68 real pairs of cars and robots at most a third, in rooms half of them.
UPPER_NEARER, SURELY = 0.8, 3.0  # and by so many deviations of what chance makes of a half


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """
    What two photographs tell; angles in rad, nan where nothing can be known.

    Bearings are those of the other camera's centre, right positive; ``rotation`` is the heading of
    the current against the desired view, left positive. ``fundamental``, shape (3, 3), is in
    pixels. ``planar`` is False where the general geometry had to be used; ``tilt``, down positive,
    and ``roll``, clockwise, are those of the camera, where the pair tells them. Bearings and
    ``rotation`` are those in the ``ground`` plane where tilt and roll are known, else in the
    cameras' own axes. ``deviation`` is the larger one of both bearings.
    """

    trusted: bool
    reason: str
    bearing_current: float = math.nan
    bearing_desired: float = math.nan
    rotation: float = math.nan
    sigma: float = math.nan
    deviation: float = math.nan
    rotation_deviation: float = math.nan
    parallax_px: float = math.nan
    inliers: int = 0
    planar: bool = True
    ground: bool = True
    tilt: float = math.nan
    roll: float = math.nan
    current: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    desired: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    fundamental: FloatArray | None = None


def inspect(
    desired: Image,
    current: Image,
    desired_camera: CameraModel,
    current_camera: CameraModel,
    settings: PerceptionSettings,
    matcher: Matcher = SIFT,
) -> Inspection:
    """
    Compare two photographs, uint8 of shape (H, W) each, of any size, matched by ``matcher``.

    Never raises for what the photographs show: a blank one, or one of another place, is an
    inspection that is not trusted.
    """
    canvas = Canvas.of(current_camera) if current_camera == desired_camera else PLANE
    try:
        view, painted = desired_view(desired, matcher, canvas=canvas), canvas.painted(current)
        matches = _aligned(view, match(view, painted), painted)
    except TrackingError as error:
        return Inspection(False, str(error))
    pixels_current = canvas.pixels_of_image(matches.current)
    pixels_desired = canvas.pixels_of_image(matches.desired)
    rays_current = current_camera.rays(pixels_current)
    rays_desired = desired_camera.rays(pixels_desired)
    usable = current_camera.round_trips(pixels_current, rays_current)
    usable &= desired_camera.round_trips(pixels_desired, rays_desired)
    pixels_current, pixels_desired = pixels_current[usable], pixels_desired[usable]
    rays_current, rays_desired = rays_current[usable], rays_desired[usable]
    resolution = np.stack(
        [current_camera.resolution(rays_current), desired_camera.resolution(rays_desired)], axis=1
    )
    observation = Observation(
        0,
        rays_current,
        rays_desired,
        current_camera.focal,
        pixel_angles=resolution,
        wide=current_camera.wide,
        shared=overlap(matches.current, painted.shape),
    )
    found, essential = judged(observation, settings)
    doubt = doubtful_tilt(current_camera, found.tilt)
    if found.trusted and doubt:
        found = replace(found, trusted=False, reason=doubt)
    in_px = None if essential is None else _in_pixels(essential, current_camera, desired_camera)
    return replace(found, current=pixels_current, desired=pixels_desired, fundamental=in_px)


def _aligned(view: DesiredView, matches: Matches, image: Image) -> Warps:
    """Return the matches aligned to a fraction of a pixel, and more where they are few."""
    start, anchor, pixels = warps_of(matches, view), Anchor(view.image), float_image(image)
    alignment = anchor.align(start, pixels, iterations=FIRST_ITERATIONS)
    good = alignment.correlation >= MIN_CORRELATION
    if int(good.sum()) < MIN_MATCHES:
        if not np.ptp(view.keypoints.sizes):  # of a matcher without sizes: too coarse
            raise TrackingError(
                f'of {len(good)} matches {int(good.sum())} show the same, {MIN_MATCHES} are '
                'needed; move nearer, or take the photograph in such light'
            )
        return start  # blurred, or seen from far aside: as SIFT has them
    found = alignment.warps.take(good)
    for _ in range(ROUNDS):
        more = among_neighbours(found, view, anchor, pixels, ENOUGH - len(found))
        alignment = anchor.align(more, pixels, iterations=FIRST_ITERATIONS)
        found = found.joined(alignment.warps.take(alignment.correlation >= AMONG_NEIGHBOURS))
    return found


def _in_pixels(
    fundamental: FloatArray, current_camera: CameraModel, desired_camera: CameraModel
) -> FloatArray | None:
    """Return F in pixels, which only pinholes have."""
    if current_camera.planar is None or desired_camera.planar is None:
        return None
    return in_pixels(fundamental, current_camera.matrix, desired_camera.matrix)


def judged(
    observation: Observation, settings: PerceptionSettings
) -> tuple[Inspection, FloatArray | None]:
    """
    Return what matches tell as rays, and E for them, (3, 3), if there is one.

    The motion is planar where that is the simplest that explains the matches, else a general one;
    the deviation of the general one holds for both: it looks around for whatever else may be true.
    """
    if len(observation) < settings.min_features:
        few = Reason.FEW_FEATURES.of(len(observation), settings.min_features)
        return Inspection(False, few), None
    turn = fit_rotation(observation.current, observation.desired)
    found = Inspection(False, '', parallax_px=turn.parallax * observation.focal)
    rays = rays_of(observation.current, observation.desired, observation.resolution)
    try:
        fit, spread = spread_of(general_motion(rays), observation.shared)
    except DegenerateGeometryError as error:
        return replace(found, reason=str(error)), None
    planar = _simplest_planar(observation, fit, spread, settings)
    general = _with_general(found, fit, spread, settings.mount)
    essential = fit.best.essentials[0]
    if planar is None:
        found = replace(general, reason=f'the motion was not planar: {GENERAL}')
    else:
        found = _with_planar(found, planar, spread)
        if not general.ground:
            found = replace(found, deviation=_of_unknown_vertical(found, general))
        if found.deviation > UNLEVEL * general.deviation:
            general = replace(general, tilt=found.tilt, roll=found.roll)
            found = replace(general, reason=f'the matches do not show what is level: {GENERAL}')
        else:
            essential = planar.fundamental
    reason = _refusal(found, fit, settings.mount)
    if not reason and planar is not None and planar.attitude is not None:
        reason = outside_mount(planar.attitude, settings.mount)
    if reason_of(reason) in (Reason.NONE, Reason.UNCERTAIN):  # by a wrong lens, it may be
        reason = _wrong_lens(observation, fit, settings, general=planar is None) or reason
    reason = reason or _upside_down(observation, fit, found.tilt, settings.mount)
    return _concluded(found, reason, turn.heading_error), essential


def _upside_down(observation: Observation, fit: GeneralFit, tilt: float, mount: Attitude) -> str:
    """
    Return that both photographs may be upside down, in words, or ''.

    No geometry of matches tells that, but a robot is nearer to the floor than to what is above it:
    of where the horizon is, which ``tilt`` tells, or nothing does. A configured mount is right.
    """
    if _is_told(mount) or math.isnan(tilt):
        return ''
    inliers, baseline = fit.inliers, fit.motions.baseline[0]
    desired = observation.desired[inliers]
    turned = observation.current[inliers] @ fit.motions.rotation[0].T
    across = np.linalg.norm(np.cross(turned, baseline), axis=1)
    inverse_depth = np.linalg.norm(np.cross(turned, desired), axis=1) / np.maximum(across, 1e-9)
    down = desired @ rotation_level_camera(tilt, 0.0)[1]
    off = math.sin(OFF_HORIZON)
    upper, lower = (
        inverse_depth[side & (across > OFF_BASELINE)] for side in (down < -off, down > off)
    )
    pairs = max(len(upper) * len(lower), 1)
    share = (upper[:, None] > lower).sum() / pairs
    chance = math.sqrt((len(upper) + len(lower) + 1) / (12.0 * pairs))  # of a rank sum
    if share < max(UPPER_NEARER, 0.5 + SURELY * chance):
        return ''
    return (
        'both photographs may be upside down: what is above the horizon is nearer than what is '
        'below; turn both upright, or tell how the camera is mounted'
    )


def _is_told(mount: Attitude) -> bool:
    """Return whether tilt and roll are given, not those of any camera."""
    return max(mount.tilt_deviation, mount.roll_deviation) < REPORTED


def _of_unknown_vertical(planar: Inspection, general: Inspection) -> float:
    """
    Return the deviation of ``planar`` bearings with that of the ground plane they are in.

    Two views do not tell the axis of a robot's turn, which is vertical, from that of a hand's. The
    cameras' own axes, which ``general`` bearings are in, are certain: what both differ by is not.
    """
    away = (
        planar.bearing_current - general.bearing_current,
        planar.bearing_desired - general.bearing_desired,
    )
    largest = max(abs(math.remainder(each, 2.0 * math.pi)) for each in away)
    return math.hypot(planar.deviation, VERTICAL * largest)


def _wrong_lens(
    observation: Observation, fit: GeneralFit, settings: PerceptionSettings, *, general: bool
) -> str:
    """
    Return that the matches contradict the focal length, in words, or ''.

    A motion that is not planar looks like another focal length: where it is ``general``, a planar
    one of another focal length must explain the matches better.
    """
    reason = contradicted_by_pair(observation, settings)
    if not reason or not general:
        return reason
    fundamental = perceive(observation, uncalibrated(settings), 0).fundamental
    costs = [fit.plain_cost(essential) for essential in fit.motions.essentials]
    better = fundamental is not None and fit.plain_cost(fundamental) < min(costs)
    return reason if better else ''


def _simplest_planar(
    observation: Observation,
    fit: GeneralFit,
    spread: Spread,
    settings: PerceptionSettings,
) -> Estimate | None:
    """Return the planar motion of the matches where no other explains them better."""
    try:
        planar = estimate(
            settings.estimator,
            observation.current,
            observation.desired,
            noise=fit.scale * observation.resolution,
            prior=prior_of(fresh_memory(settings), settings, observation),
            seed=(settings.seed, 0),
        )
    except DegenerateGeometryError:
        return None
    if planar.inliers.sum() < PLANAR_SHARE * fit.inliers.sum():
        return None  # its twin may explain more, as in a mirrored image
    return planar if planar_is_simplest(planar, fit, spread, settings.mount) else None


def _with_planar(found: Inspection, planar: Estimate, spread: Spread) -> Inspection:
    bearings, attitude = planar.bearings, planar.attitude
    deviations = np.maximum(planar_deviations(planar, spread), spread.whole)
    found = replace(
        found,
        bearing_current=bearings.current,
        bearing_desired=bearings.desired,
        rotation=bearings.heading_error,
        sigma=bearings.sigma,
        deviation=float(deviations[:2].max()),
        rotation_deviation=float(deviations[2]),
        inliers=int(planar.inliers.sum()),
    )
    if attitude is None:
        return found
    return replace(
        found,
        tilt=attitude.tilt if attitude.tilt_deviation < REPORTED else math.nan,
        roll=attitude.roll if attitude.roll_deviation < REPORTED else math.nan,
    )


def _with_general(
    found: Inspection, fit: GeneralFit, spread: Spread, mount: Attitude
) -> Inspection:
    """Return what is found with a general motion: in the ground plane by a known mount."""
    known = _is_told(mount)
    level = rotation_level_camera(mount.tilt, mount.roll) if known else np.eye(3)
    levelled = Motions(level @ fit.best.rotation @ level.T, fit.best.baseline @ level.T)
    current, desired, rotation = levelled.bearings[0].tolist()
    return replace(
        found,
        bearing_current=current,
        bearing_desired=desired,
        rotation=rotation,
        sigma=-math.copysign(1.0, math.cos(current)),
        deviation=float(spread.whole[:2].max()),
        rotation_deviation=float(spread.whole[2]),
        inliers=int(fit.inliers.sum()),
        planar=False,
        ground=known,
    )


def _refusal(found: Inspection, fit: GeneralFit, mount: Attitude) -> str:
    """Return why what is ``found`` is not to be trusted, in words, or ''."""
    count = len(fit.inliers)
    if min(found.inliers, int(fit.inliers.sum())) < max(MIN_MATCHES, MIN_SHARE * count):
        return Reason.FEW_INLIERS.of(found.inliers, count)
    if found.deviation > LARGEST_DEVIATION:
        return _uncertain(found, fit)
    rotation, baseline = fit.motions.rotation[0], fit.motions.baseline[0]
    rolled = rolled_between(rotation, baseline, mount)
    return rolled or turned_about(rotation, baseline, mount)


def _uncertain(found: Inspection, fit: GeneralFit) -> str:
    """Return why bearings are uncertain: no baseline, a second answer, or too few matches."""
    if found.parallax_px < NEAR_PX:
        parallax = Reason.SMALL_PARALLAX.of(found.parallax_px)
        return f'{_nearness(found.parallax_px)}: {parallax}'
    degrees = math.degrees(found.deviation)
    if found.deviation > FAR:
        return (
            f'ambiguous: a motion {degrees:.0f} deg or more aside explains the matches nearly '
            'as well'
        )
    return Reason.UNCERTAIN.of(degrees)


def _concluded(found: Inspection, reason: str, heading: float) -> Inspection:
    """Return the verdict; no bearings that nothing fixes, nor a heading but that of a turn."""
    if not reason:
        return replace(found, trusted=True)
    found = replace(found, trusted=False, reason=reason)
    if found.parallax_px < SAME_PLACE_PX:
        found = replace(found, rotation=heading)
    if found.rotation_deviation > LARGEST_TURN_DEVIATION:
        found = replace(found, rotation=math.nan)
    if found.deviation > FAR or found.parallax_px < SAME_PLACE_PX:
        found = replace(found, bearing_current=math.nan, bearing_desired=math.nan)
        found = replace(found, sigma=math.nan, inliers=0, tilt=math.nan, roll=math.nan)
    return found


def _nearness(parallax_px: float) -> str:
    """Return where photographs were taken that a turn of the camera alone explains so well."""
    if parallax_px < SAME_PLACE_PX:
        return 'taken from the same place'
    return 'taken from nearly the same place, or of what is far away'
