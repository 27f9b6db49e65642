"""Two photographs, no robot: epipoles, bearings, rotation, and whether to trust them."""

from dataclasses import dataclass, field, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.plausibility import doubtful_tilt
from visual_servo_epipolar.core.errors import DegenerateGeometryError, TrackingError
from visual_servo_epipolar.core.geometry.epipolar import in_pixels, MIN_MATCHES
from visual_servo_epipolar.core.geometry.lens import REACH
from visual_servo_epipolar.core.geometry.rays import rotation_level_camera
from visual_servo_epipolar.core.geometry.rotation import fit_rotation, rotation_vector
from visual_servo_epipolar.core.reasons import Reason, reason_of
from visual_servo_epipolar.core.tracking.alignment import Anchor, FIRST_ITERATIONS
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
from visual_servo_epipolar.core.tracking.sampling import float_image, overlap
from visual_servo_epipolar.core.tracking.warps import Warps
from visual_servo_epipolar.core.twoview.estimator import Attitude, Estimate
from visual_servo_epipolar.core.twoview.general_motion import (
    general_motion,
    GeneralFit,
    Motions,
    Spread,
    spread_of,
)
from visual_servo_epipolar.core.twoview.hypotheses import rays_of
from visual_servo_epipolar.core.twoview.lens_check import contradicted_by_pair
from visual_servo_epipolar.core.twoview.memory import fresh_memory
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.planar_motion import JITTER_DEVIATIONS
from visual_servo_epipolar.core.twoview.registry import estimate
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings
from visual_servo_epipolar.core.twoview.validation import prior_of

MIN_CORRELATION = 0.75
ENOUGH, ROUNDS = 250, 2  # matches; searches for more among their neighbours
AMONG_NEIGHBOURS = 0.85  # correlation of those, for which no descriptor speaks
MIN_SHARE = 0.5  # of the matches that must agree
REPORTED = math.radians(3.0)  # deviation of tilt or roll beyond which it is not reported
LARGEST_DEVIATION = math.radians(1.5)  # of bearings that are trusted: half of what is wrong
UNLEVEL = 2.0  # ratio of deviations beyond which the ground plane costs too much
VERTICAL = 0.5  # share of what an estimated ground plane changes that counts as its deviation
FAR = math.radians(15.0)  # between two answers
ROLLED = math.radians(20.0)  # more than a hand makes between photographs, or of both
IN_PLANE = math.radians(0.8)  # of the baseline and the plane of motion


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

    @property
    def sigma(self) -> float:
        """Sign of cos(psi - theta): -1 while the goal camera lies ahead of the current one."""
        ahead = math.cos(self.bearing_current)
        return math.nan if math.isnan(ahead) else -math.copysign(1.0, ahead)


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
    cameras = current_camera, desired_camera
    both = [canvas.pixels_of_image(points) for points in (matches.current, matches.desired)]
    rays = [camera.rays(points) for camera, points in zip(cameras, both, strict=True)]
    sides = [*zip(cameras, both, rays, strict=True)]
    usable = np.logical_and(*(camera.round_trips(points, seen) for camera, points, seen in sides))
    pixels, rays = ([side[usable] for side in each] for each in (both, rays))
    angles = [camera.resolution(seen) for camera, seen in zip(cameras, rays, strict=True)]
    observation = Observation(
        0,
        rays[0],
        rays[1],
        current_camera.focal,
        pixel_angles=np.stack(angles, axis=1),
        wide=current_camera.wide,
        shared=overlap(matches.current, painted.shape),
    )
    found, essential = judged(observation, settings)
    found = replace(found, current=pixels[0], desired=pixels[1])
    if found.trusted and (doubt := doubtful_tilt(current_camera, found.tilt)):
        found = replace(found, trusted=False, reason=doubt)
    if essential is None or current_camera.planar is None or desired_camera.planar is None:
        return found
    matrix = in_pixels(essential, current_camera.matrix, desired_camera.matrix)
    return replace(found, fundamental=matrix)


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
    found = _general(found, fit, spread, settings.mount)
    planar = _simplest_planar(observation, fit, spread, settings)
    why = 'the motion was not planar: general epipolar geometry'
    if planar is not None:
        level = _levelled(found, fit.best, planar, spread)
        if level.deviation > UNLEVEL * found.deviation:
            found = replace(found, tilt=level.tilt, roll=level.roll)
            why = 'the matches do not show what is level: general epipolar geometry'
        else:
            found, why = level, ''
    reason = _refusal(found, fit, settings)
    if reason_of(reason) in (Reason.NONE, Reason.UNCERTAIN):  # by a wrong lens, it may be
        reason = _wrong_lens(observation, fit, settings, general=planar is None) or reason
    essential = fit.best.essentials[0]
    if reason:
        return _refused(found, reason, turn.heading_error, settings.pixel_noise), essential
    return replace(found, trusted=True, reason=why), essential


def _general(found: Inspection, fit: GeneralFit, spread: Spread, mount: Attitude) -> Inspection:
    """Return what is found with the general motion: in the ground plane by a known mount."""
    known = max(mount.tilt_deviation, mount.roll_deviation) < REPORTED
    axes = rotation_level_camera(mount.tilt, mount.roll) if known else np.eye(3)
    current, desired, rotation = fit.best.turned(axes).bearings[0].tolist()
    return replace(
        found,
        bearing_current=current,
        bearing_desired=desired,
        rotation=rotation,
        deviation=float(spread.whole[:2].max()),
        rotation_deviation=float(spread.whole[2]),
        inliers=int(fit.inliers.sum()),
        planar=False,
        ground=known,
    )


def _levelled(found: Inspection, best: Motions, planar: Estimate, spread: Spread) -> Inspection:
    """
    Return what is ``found`` with bearings in the ground plane of a ``planar`` motion.

    A level plane is as far from that of motion as tilt and roll are unknown: to second order that
    turns bearings between the axis and across it. Two views do not tell the axis of a robot's
    turn, which is vertical, from that of a hand's: where the mount is not known, half of what the
    ground plane changes of bearings in the cameras' own axes, which are certain, is doubtful.
    """
    attitude = planar.attitude or Attitude()
    level = rotation_level_camera(attitude.tilt, attitude.roll)
    current, desired, rotation = best.turned(level).bearings[0].tolist()
    angles = np.array([current, desired])
    lean = attitude.tilt_deviation**2 + attitude.roll_deviation**2
    variances = planar.whole_covariance.diagonal()[::-1] + (0.5 * lean * np.sin(2.0 * angles)) ** 2
    deviation = float(np.maximum(np.sqrt(variances), spread.whole[:2]).max())
    if not found.ground:
        away = angles - [found.bearing_current, found.bearing_desired]
        away = np.abs(np.remainder(away + np.pi, 2.0 * np.pi) - np.pi)
        deviation = math.hypot(deviation, VERTICAL * float(away.max()))
    return replace(
        found,
        bearing_current=current,
        bearing_desired=desired,
        rotation=rotation,
        deviation=deviation,
        planar=True,
        ground=True,
        tilt=attitude.tilt if attitude.tilt_deviation < REPORTED else math.nan,
        roll=attitude.roll if attitude.roll_deviation < REPORTED else math.nan,
    )


def _simplest_planar(
    observation: Observation, fit: GeneralFit, spread: Spread, settings: PerceptionSettings
) -> Estimate | None:
    """
    Return the planar motion of the matches where no other explains them better, or None.

    By minimum description length: it has a parameter less, which is worth log(N) of the robust
    cost (Torr's GRIC weighs costs the same way). Costs are at the scale of the residuals, less
    what their tails add: by shares of inliers, each attitude that bends far enough would do.
    """
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
    if planar.attitude is None:
        return None
    mount = settings.mount
    costs = fit.losses(Motions.of(planar.fundamental[None]).twins).sum(axis=1)
    excess = float(costs.min() - fit.losses(fit.best).sum()) / spread.tails
    excess += (planar.jump / (JITTER_DEVIATIONS * mount.jitter)) ** 2 if mount.jitter else 0.0
    excess += ((planar.attitude.tilt - mount.tilt) / mount.tilt_deviation) ** 2
    excess += ((planar.attitude.roll - mount.roll) / mount.roll_deviation) ** 2
    return planar if excess <= math.log(len(observation)) else None


def _refusal(found: Inspection, fit: GeneralFit, settings: PerceptionSettings) -> str:
    """Return why what is ``found`` is not to be trusted, in words, or ''."""
    count, parallax = len(fit.inliers), found.parallax_px
    if found.inliers < max(MIN_MATCHES, MIN_SHARE * count):
        return Reason.FEW_INLIERS.of(found.inliers, count)
    if parallax < settings.min_parallax:
        far = '' if parallax < settings.pixel_noise else 'nearly '
        also = ', or of what is far away' if far else ''
        return f'taken from {far}the same place{also}: {Reason.SMALL_PARALLAX.of(parallax)}'
    degrees = math.degrees(found.deviation)
    if found.deviation <= LARGEST_DEVIATION:
        return _rolled(fit.best, settings.mount)
    if found.deviation > FAR:
        return (
            f'ambiguous: a motion {degrees:.0f} deg or more aside explains the matches nearly '
            'as well'
        )
    return Reason.UNCERTAIN.of(degrees)


def _rolled(best: Motions, mount: Attitude) -> str:
    """
    Return that photographs were rolled by more than a hand does, in words, or ''.

    One against the other: a turn about the vertical of a tilted camera shows as a roll, too. Both
    alike: a motion is planar where the axis of its rotation is across the baseline,
    by chance that is seldom so, and the axis is then the vertical of the camera.
    """
    rotation, baseline = best.rotation[0], best.baseline[0]
    roll = math.atan2(rotation[0, 1] - rotation[1, 0], rotation[0, 0] + rotation[1, 1])
    turn = rotation_vector(rotation)
    angle = math.sqrt(float(turn @ turn))
    tilted = abs(mount.tilt) + REACH * mount.tilt_deviation
    if abs(roll) > ROLLED + abs(float(turn[1])) * math.tan(tilted):
        way = 'clockwise' if roll > 0.0 else 'counterclockwise'
        return (
            f'the current photograph is rolled by {abs(math.degrees(roll)):.0f} deg {way} against '
            'the desired one; turn it upright'
        )
    if angle < REPORTED or abs(float(turn @ baseline)) > angle * math.sin(IN_PLANE):
        return ''
    x, y, _ = turn * math.copysign(1.0, turn[1])
    off = math.atan2(x, y) - mount.roll
    if abs(off) < max(ROLLED, REACH * mount.roll_deviation + REPORTED):
        return ''
    return (
        f'both photographs seem rolled by {math.degrees(off):.0f} deg; turn both upright, or tell '
        'how the camera is mounted'
    )


def _wrong_lens(
    observation: Observation, fit: GeneralFit, settings: PerceptionSettings, *, general: bool
) -> str:
    """
    Return that the matches contradict the focal length, in words, or ''.

    A motion that is not planar looks like another focal length: where it is ``general``, a planar
    one of another focal length must explain the matches better.
    """
    reason, fundamental = contradicted_by_pair(observation, settings)
    if not reason or not general:
        return reason
    costs = fit.plain_losses(fit.motions.essentials).sum(axis=1)
    better = fundamental is not None and fit.plain_losses(fundamental).sum() < costs.min()
    return reason if better else ''


def _refused(found: Inspection, reason: str, heading: float, noise: float) -> Inspection:
    """Return the refusal; no bearings that nothing fixes, nor a heading but that of a turn."""
    found = replace(found, reason=reason)
    if found.parallax_px < noise:
        found = replace(found, rotation=heading)
    if found.rotation_deviation > LARGEST_DEVIATION:
        found = replace(found, rotation=math.nan)
    if found.deviation > FAR or found.parallax_px < noise:
        found = replace(found, bearing_current=math.nan, bearing_desired=math.nan)
        found = replace(found, inliers=0, tilt=math.nan, roll=math.nan)
    return found
