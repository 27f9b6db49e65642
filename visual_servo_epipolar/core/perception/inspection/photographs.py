"""Two photographs, no robot: epipoles, bearings, rotation, and whether to trust them."""

from dataclasses import replace

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.plausibility import doubtful_tilt
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.geometry.epipolar import in_pixels
from visual_servo_epipolar.core.perception.inspection.judgement import Inspection, judged
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.perception.settings import PerceptionSettings
from visual_servo_epipolar.core.tracking.alignment.sampling import float_image, overlap
from visual_servo_epipolar.core.tracking.alignment.template_alignment import Anchor
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
from visual_servo_epipolar.core.tracking.robust_geometry import MIN_MATCHES

REFINEMENT = 15  # iterations of the alignment after the match
MIN_CORRELATION = 0.75
ENOUGH, ROUNDS = 250, 2  # matches; searches for more among their neighbours
AMONG_NEIGHBOURS = 0.85  # correlation of those, for which no descriptor speaks


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
    alignment = anchor.align(start, pixels, iterations=REFINEMENT)
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
        alignment = anchor.align(more, pixels, iterations=REFINEMENT)
        found = found.joined(alignment.warps.take(alignment.correlation >= AMONG_NEIGHBOURS))
    return found


def _in_pixels(
    fundamental: FloatArray, current_camera: CameraModel, desired_camera: CameraModel
) -> FloatArray | None:
    """Return F in pixels, which only pinholes have."""
    if current_camera.planar is None or desired_camera.planar is None:
        return None
    return in_pixels(fundamental, current_camera.matrix, desired_camera.matrix)
