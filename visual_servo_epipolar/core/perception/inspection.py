"""Two photographs, no robot: epipoles, bearings, rotation, and whether to believe them."""

from dataclasses import dataclass, field, replace
import math

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.estimators.base import Attitude
from visual_servo_epipolar.core.geometry.camera import Camera, LEAST_FORWARD
from visual_servo_epipolar.core.geometry.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.cameras.plausibility import doubtful_tilt
from visual_servo_epipolar.core.geometry.epipolar import in_pixels
from visual_servo_epipolar.core.geometry.rays import image_points
from visual_servo_epipolar.core.perception.lens_check import contradicted_by_pair
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.perception.perceive import perceive
from visual_servo_epipolar.core.perception.settings import PerceptionSettings
from visual_servo_epipolar.core.perception.validation import (
    MAX_JUMP,
    on_its_side,
    outside_mount,
    rolled_between,
)
from visual_servo_epipolar.core.tracking.alignment.sampling import float_image
from visual_servo_epipolar.core.tracking.alignment.template_alignment import Anchor
from visual_servo_epipolar.core.tracking.alignment.warps import Warps
from visual_servo_epipolar.core.tracking.matching import desired_view, DesiredView, match, Matches

REFINEMENT = 15  # iterations of the alignment after the match
MIN_CORRELATION = 0.75
PLANAR_SHARE = 0.7  # of the matches: below, the motion is not planar
GENERAL_PX = 1.5  # inlier threshold of the general geometry
TOLD = math.radians(3.0)  # deviation of tilt or roll beyond which it is not told
SAME_PLACE_PX = 0.3  # parallax that noise alone makes


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """
    What two photographs tell; angles in rad, nan where nothing can be told.

    Bearings are those of the other camera's centre, right positive; ``rotation`` is the heading of
    the current against the desired view, left positive. ``fundamental``, shape (3, 3), is in
    pixels. ``planar`` is False where the general geometry had to be used; ``tilt``, down positive,
    and ``roll``, clockwise, are those of the camera, where the pair tells them.
    """

    trusted: bool
    reason: str
    bearing_current: float = math.nan
    bearing_desired: float = math.nan
    rotation: float = math.nan
    sigma: float = math.nan
    deviation: float = math.nan
    parallax_px: float = math.nan
    inliers: int = 0
    planar: bool = True
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
) -> Inspection:
    """
    Compare two photographs, uint8 of shape (H, W) each, of any size.

    Never raises for what the photographs show: a blank one, or one of another place, is an
    inspection that is not trusted.
    """
    try:
        view = desired_view(desired)
        pixels_current, pixels_desired = _aligned(view, match(view, current), current)
    except TrackingError as error:
        return Inspection(False, str(error))
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
    )
    perception = perceive(observation, settings, 0)
    seen, fundamental = perception.measurement, perception.fundamental
    found = replace(
        _planar(seen, perception.memory.attitude),
        current=pixels_current,
        desired=pixels_desired,
        fundamental=None
        if fundamental is None
        else _in_pixels(fundamental, current_camera, desired_camera),
    )
    if math.isnan(seen.parallax_px):
        return found  # too few matches for anything
    if seen.parallax_px < settings.min_parallax:
        return replace(found, reason=f'{_nearness(seen.parallax_px)}: {found.reason}')
    share = found.inliers / len(rays_current)
    planar = share >= PLANAR_SHARE and seen.jump <= MAX_JUMP * settings.floor_jitter
    if planar:
        found = _refused(found, outside_mount(perception.memory.attitude, settings.mount))
        found = _refused(found, doubtful_tilt(current_camera, found.tilt))
    else:
        found = _general(found, observation, current_camera, desired_camera, settings.mount)
    return _refused(found, contradicted_by_pair(observation, settings)) if found.trusted else found


def _refused(found: Inspection, reason: str) -> Inspection:
    """Return what is ``found``, not to be trusted for a ``reason`` if there is one."""
    return replace(found, trusted=False, reason=reason) if found.trusted and reason else found


def _nearness(parallax_px: float) -> str:
    """Return where photographs were taken that a turn of the camera alone explains so well."""
    if parallax_px < SAME_PLACE_PX:
        return 'taken from the same place'
    return 'taken from nearly the same place, or of what is far away'


def _aligned(view: DesiredView, matches: Matches, image: Image) -> tuple[FloatArray, FloatArray]:
    """Return the matches, current and desired, aligned to a fraction of a pixel."""
    desired = view.keypoints.pixels[matches.indices]
    affine = matches.scales[:, None, None] * np.eye(2)
    start = Warps(matches.indices, desired, matches.pixels, affine)
    alignment = Anchor(view.image).align(start, float_image(image), iterations=REFINEMENT)
    good = alignment.correlation >= MIN_CORRELATION
    if int(good.sum()) < 8:
        return matches.pixels, desired  # blurred, or seen from far aside: as SIFT has them
    return alignment.warps.current[good], desired[good]


def _planar(seen: Measurement, attitude: Attitude) -> Inspection:
    bearings = seen.bearings
    base = Inspection(
        bearings is not None,
        seen.reason,
        rotation=seen.heading_error,
        deviation=seen.deviation,
        parallax_px=seen.parallax_px,
        inliers=seen.inliers,
    )
    if bearings is None:
        return base
    return replace(
        base,
        bearing_current=bearings.current,
        bearing_desired=bearings.desired,
        sigma=bearings.sigma,
        tilt=attitude.tilt if attitude.tilt_deviation < TOLD else math.nan,
        roll=attitude.roll if attitude.roll_deviation < TOLD else math.nan,
    )


def _in_pixels(
    fundamental: FloatArray, current_camera: CameraModel, desired_camera: CameraModel
) -> FloatArray | None:
    """Return F in pixels, which only pinholes have."""
    if isinstance(current_camera, Camera) and isinstance(desired_camera, Camera):
        return in_pixels(fundamental, current_camera.matrix, desired_camera.matrix)
    return None


def _general(
    found: Inspection,
    observation: Observation,
    current_camera: CameraModel,
    desired_camera: CameraModel,
    mount: Attitude,
) -> Inspection:
    """Return the five-point geometry (Nister 2004, by OpenCV) where motion is not planar."""
    threshold = GENERAL_PX / observation.focal
    front = np.minimum(observation.current[:, 2], observation.desired[:, 2]) > LEAST_FORWARD
    points = image_points(observation.current[front]), image_points(observation.desired[front])
    try:
        essential, mask = cv2.findEssentialMat(
            *points, np.eye(3), cv2.USAC_MAGSAC, 0.999, threshold
        )
    except cv2.error:  # OpenCV 5 asserts that there is a model, where few matches gave none
        essential = None
    share = found.inliers / max(len(observation.current), 1)
    reason = found.reason or f'only {100.0 * share:.0f} % of the matches fit a planar motion'
    if essential is None or essential.shape != (3, 3):
        return replace(found, trusted=False, reason=f'{reason}, and no general geometry fits')
    _, rotation, translation, inliers = cv2.recoverPose(essential, *points, np.eye(3), mask=mask)
    centre = translation.ravel()
    goal = -rotation.T @ centre
    current = math.atan2(goal[0], goal[2])
    count = int((inliers > 0).sum())
    general = replace(
        found,
        trusted=count >= PLANAR_SHARE * int(front.sum()),
        reason=f'{reason}: general epipolar geometry',
        bearing_current=current,
        bearing_desired=math.atan2(centre[0], centre[2]),
        rotation=math.atan2(rotation[2, 0] - rotation[0, 2], rotation[0, 0] + rotation[2, 2]),
        sigma=-math.copysign(1.0, math.cos(current)),
        deviation=math.nan,
        tilt=math.nan,
        roll=math.nan,
        inliers=count,
        planar=False,
        fundamental=_in_pixels(essential, current_camera, desired_camera),
    )
    return _refused(
        general, rolled_between(rotation, centre, mount) or on_its_side(rotation, centre)
    )
