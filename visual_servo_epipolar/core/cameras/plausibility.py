"""Plausibility: intrinsics that no camera has, and lenses that can be inverted in part only."""

from functools import lru_cache
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.cameras.model import CameraModel

FARTHEST_OUTSIDE = 0.5  # of the image's size, that the principal point of a crop may lie beyond
OFF_CENTRE = 0.2  # of the image's size, that a principal point may lie off the middle
SCALED, SAME_SCALE = 0.1, 0.06  # that it lies off by in proportion where K is of another size
RESOLUTIONS = (1 / 4, 1 / 3, 1 / 2, 2 / 3, 3 / 4, 4 / 5, 5 / 4, 4 / 3, 3 / 2, 2, 3, 4)
OFF_TILT, LIKE_TILT = math.radians(3.0), 0.4  # that is doubted, and how alike the two are, of it
MOST_SKEW = 0.2  # of the focal length: pixels are all but rectangles
NARROWEST, WIDEST_PINHOLE = 1.0, 170.0  # field of view [deg]
MOST_LOST = 0.2  # of the image, where the distortion cannot be undone
MOST_OBLONG = 4.0  # pixel: binned in one direction, or every other line
SAMPLES = 24  # a row and a column, over the image
AXIS = np.array([[0.0, 0.0, 1.0]])
CALIBRATION_DEG = 1.0  # that a ray may differ from one calibration to another
NAMED = 4  # numbers that differ, in a message


def refuse_implausible(camera: CameraModel, *, cropped: bool = False) -> None:
    """
    Raise ValueError for intrinsics that no camera has: they are another image's, or a slip.

    Only where the image is ``cropped`` may the principal point lie far off its middle.
    """
    fault = _fault(camera) or ('' if cropped else _off_centre(camera))
    if fault:
        raise ValueError(fault)


@lru_cache(maxsize=16)
def doubts(camera: CameraModel) -> str:
    """Return the warning on a camera that can be used all the same, or ''."""
    pixels = _samples(camera)
    lost = 1.0 - float(camera.round_trips(pixels, camera.rays(pixels)).mean())
    if lost <= MOST_LOST:
        return ''
    return (
        f'the distortion of camera_info ({camera.lens}) cannot be undone in {100.0 * lost:.0f} % '
        'of the image, features there are left out; a wide lens needs equidistant: calibrate it '
        'as a fisheye'
    )


def doubtful_tilt(camera: CameraModel, tilt: float) -> str:
    """
    Return that a principal point off the middle makes a level camera tilt by ``tilt``, or ''.

    Parameters
    ----------
    tilt : float
        That two views found [rad], down positive; nan where they tell none.

    """
    middle = np.array([[0.5 * (camera.width - 1.0), 0.5 * (camera.height - 1.0)]])
    (_, down, forward), *_ = camera.rays(middle)
    off = math.atan2(-down, forward)
    is_off = abs(off) > OFF_TILT or _is_scaled(camera, SAME_SCALE)
    if not (is_off and abs(tilt - off) < LIKE_TILT * abs(off)):
        return ''
    return (
        f'a tilt of {math.degrees(tilt):+.1f} deg is what a level camera seems to have where K is '
        f'of another image: its principal point is {math.degrees(off):+.1f} deg off the middle; '
        'calibrate at the resolution in use'
    )


def are_alike(one: CameraModel, other: CameraModel) -> bool:
    """Return whether both see the same directions: one camera, maybe calibrated anew."""
    return _apart(one, other) < CALIBRATION_DEG


def differences(one: CameraModel, other: CameraModel) -> str:
    """Return in words which numbers of two cameras differ, with the digits that show it."""
    if (one.width, one.height) != (other.width, other.height):
        return f'{one.width}x{one.height} -> {other.width}x{other.height} px'
    words = [f'{one.lens} -> {other.lens} lens'] if one.lens != other.lens else []
    numbers = _numbers(one), _numbers(other)
    for name in {**numbers[0], **numbers[1]}:
        before, after = (each.get(name, 0.0) for each in numbers)
        if before != after:
            digits = next(n for n in range(4, 18) if f'{before:.{n}g}' != f'{after:.{n}g}') + 1
            words.append(f'{name} {before:.{digits}g} -> {after:.{digits}g}')
    more = f' and {len(words) - NAMED} more numbers' if len(words) > NAMED else ''
    return f'{", ".join(words[:NAMED])}{more}, rays up to {_apart(one, other):.2g} deg apart'


def _numbers(camera: CameraModel) -> dict[str, float]:
    """Return the numbers of camera_info by their names."""
    named = {name: getattr(camera, name) for name in ('fx', 'fy', 'cx', 'cy', 'skew')}
    return named | {f'D[{k}]': value for k, value in enumerate(camera.distortion)}


def _apart(one: CameraModel, other: CameraModel) -> float:
    """Return the largest angle between what both see at one pixel [deg], inf of other images."""
    if (one.width, one.height) != (other.width, other.height):
        return math.inf
    pixels = _samples(one)
    rays, others = one.rays(pixels), other.rays(pixels)
    known = np.isfinite(rays).all(axis=1) & np.isfinite(others).all(axis=1)
    chords = np.linalg.norm(rays[known] - others[known], axis=1)
    chord = min(float(chords.max(initial=0.0)), 2.0)
    return math.degrees(2.0 * math.asin(0.5 * chord)) if known.any() else math.inf


def _samples(camera: CameraModel) -> FloatArray:
    """Return pixels, (N, 2), all over the image."""
    u, v = np.meshgrid(
        np.linspace(0.0, camera.width - 1.0, SAMPLES),
        np.linspace(0.0, camera.height - 1.0, SAMPLES),
    )
    return np.stack([u.ravel(), v.ravel()], axis=1)


@lru_cache(maxsize=16)
def _fault(camera: CameraModel) -> str:
    for name, centre, size in (
        ('u', camera.cx, camera.width),
        ('v', camera.cy, camera.height),
    ):
        reach = FARTHEST_OUTSIDE * size
        if not -reach <= centre <= size + reach:
            return (
                f'the principal point must lie in the image or near it, got {name} = {centre:.1f} '
                f'px of {size}{_likely_cause(camera)}; is the camera_info that of another image? '
                'calibrate again'
            )
    if abs(camera.skew) > MOST_SKEW * camera.fy:
        return (
            f'the skew must be small, got K[1] = {camera.skew:g} px and fy {camera.fy:g} px; '
            'calibrate again'
        )
    if not 1.0 / MOST_OBLONG <= camera.fx / camera.fy <= MOST_OBLONG:
        return (
            f'focal lengths must be alike, to a factor of {MOST_OBLONG:g}, got fx {camera.fx:g} '
            f'and fy {camera.fy:g} px; calibrate again'
        )
    widest = 360.0 if camera.planar is None else WIDEST_PINHOLE
    view = _field_of_view(camera)
    if not NARROWEST <= view <= widest:
        return (
            f'the field of view of a {camera.lens} lens must lie between {NARROWEST:g} and '
            f'{widest:g} deg, got {view:.2f}: fx {camera.fx:g} px at a width of {camera.width}; '
            'calibrate at the resolution in use'
        )
    if camera.planar is not None and not np.isfinite(camera.edges).all():
        return (
            f'the edges of the image must have rays, got {camera.edges} rad through its '
            f'{camera.lens} distortion; calibrate again'
        )
    return ''


def _off_centre(camera: CameraModel) -> str:
    """Return that the principal point is off the middle as that of another image is, or ''."""
    if np.isinf(camera.edges).all():  # it sees all around: its axes lie where its kind puts them
        return ''
    off = max(abs(scale - 1.0) for scale in _scales(camera))
    if off <= 2.0 * OFF_CENTRE and not _is_scaled(camera, SCALED):
        return ''
    size = f'{camera.width}x{camera.height} px'
    return (
        f'the principal point must lie near the middle of an image of {size}, got '
        f'{camera.cx:.1f}, {camera.cy:.1f} px{_likely_cause(camera)}; '
        'calibrate at the resolution in use, or say that the image is a crop (cropped)'
    )


def _is_scaled(camera: CameraModel, least: float) -> bool:
    """Return whether the principal point is off in proportion, as by a K that is scaled."""
    u, v = _scales(camera)
    mean = 0.5 * (u + v)
    return abs(mean - 1.0) > least and abs(u - v) < SAME_SCALE * mean


def _scales(camera: CameraModel) -> tuple[float, float]:
    """Return the principal point, from the corner, in halves of width and of height."""
    ((u, v),) = camera.pixels(AXIS).tolist()
    return (u + 0.5) / (0.5 * camera.width), (v + 0.5) / (0.5 * camera.height)


def _likely_cause(camera: CameraModel) -> str:
    """Return of which resolution K is, where its principal point tells that; or ''."""
    u, v = _scales(camera)
    misses = {n: max(abs(u / n - 1.0), abs(v / n - 1.0)) for n in RESOLUTIONS}
    scale = min(misses, key=misses.__getitem__)
    if misses[scale] > SCALED:
        return ''
    return f': K fits an image of {scale * camera.width:.0f}x{scale * camera.height:.0f} px'


def _field_of_view(camera: CameraModel) -> float:
    """Return the smaller of the angles over width and height, without coefficients [deg]."""
    spans = [
        (camera.cx / camera.fx, (camera.width - 1.0 - camera.cx) / camera.fx),
        (camera.cy / camera.fy, (camera.height - 1.0 - camera.cy) / camera.fy),
    ]
    if camera.planar is not None:
        spans = [(math.atan(before), math.atan(after)) for before, after in spans]
    return math.degrees(min(before + after for before, after in spans))
