"""
Photographs of one pose: the first defines the goal, others show it in other light.

Features are tracked in the photograph that fits the light, but lead to where the first one was
taken: their pixels are mapped to it, by what both photographs show.

A photograph may be the mean of several images taken at rest, with less noise than each: a
difference of two that gradients explain is motion, the rest is noise, and what noise does not
explain is a person who walks by.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import as_gray, FloatArray, Image, IntArray
from visual_servo_epipolar.core.cameras.model import ROUND_TRIP_PX
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.geometry.least_squares import deviation_of, linear_fit, RIDGE
from visual_servo_epipolar.core.goal import goal_id
from visual_servo_epipolar.core.tracking.alignment import (
    Anchor,
    FIRST_ITERATIONS,
)
from visual_servo_epipolar.core.tracking.canvas import Canvas, PLANE
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.matchers.base import Matcher
from visual_servo_epipolar.core.tracking.matching import (
    BORDER,
    CurrentView,
    desired_view,
    DesiredView,
    match,
    match_as_needed,
    Matches,
    warps_of,
)
from visual_servo_epipolar.core.tracking.reacquisition import NOISE_DEVIATIONS
from visual_servo_epipolar.core.tracking.robust_geometry import EPIPOLAR_PX
from visual_servo_epipolar.core.tracking.sampling import float_image, inside_border
from visual_servo_epipolar.core.tracking.tracks import (
    fit_motion,
    ImageMotion,
    OUTLIER_MEDIANS,
    Tracks,
)
from visual_servo_epipolar.core.tracking.warps import Warps

IDS = 1 << 14  # of a photograph, more than it has keypoints
SLOTS = 1023  # of that many ids each, for further photographs
ALIKE = 0.9  # correlation above which two photographs are of one light
FEW, FEW_PERIOD = 20, 3  # below so many features, matching may come after so few frames
SIZE = (64, 48)  # to which photographs are reduced: light is seen, a millimetre is not [px]
DARK_GREY = 8.0  # added to grey levels, of which logarithms are taken: noise in the dark is none
MIN_CORRELATION = 0.7  # of a patch in both: in other light edges stay, shading does not
MIN_COMMON = 30  # features in both photographs
# Of two photographs of one pose, over the width of the image: 2 to 3 deg, and 1 to 2 cm in a room.
MAX_SHIFT, MAX_PARALLAX = 0.04, 0.0015
ONE_PLACE = 0.00015  # parallax within a millimetre or two: features move smoothly
NEAR_PX = 8.0  # distance from a feature within which others move as it does
REMEDY = 'take it where the first one was taken, best when the robot has arrived there'
SAMPLES = 20_000  # pixels of a difference that are looked at
CHANGED_DEVIATIONS, CHANGED_FLOOR = 6.0, 10.0  # of a pixel that has changed, plus grey levels
CHANGED_SHARE = 0.03  # of such pixels at which something moves in view
MOTIONS = 4  # of the columns below: shift along x and y, zoom, roll


@dataclass(frozen=True, slots=True, eq=False)
class TiedView:
    """
    A photograph to track: its ``view`` and ``anchor``, and what ties it to the first of its goal.

    Its N keypoints lie at ``first_pixels``, shape (N, 2), in the first photograph, and their ids
    begin with ``first_id``.
    """

    view: DesiredView
    anchor: Anchor
    first_pixels: FloatArray
    first_id: int = 0

    @classmethod
    def first(cls, view: DesiredView) -> 'TiedView':
        """Return the photograph that defines the goal."""
        return cls(view, Anchor(view.image), view.keypoints.pixels)

    def features(self, tracks: Tracks, goal: int) -> Features:
        """Return the features of a ``goal`` that ``tracks`` of this view are."""
        warps = tracks.warps
        ids, desired = warps.ids, warps.desired
        if self.first_id:
            ids, desired = ids + self.first_id, self.first_pixels[ids]
        canvas = self.view.canvas
        return Features(
            ids,
            canvas.pixels_of_image(warps.current),
            canvas.pixels_of_image(desired),
            tracks.ages,
            tracks.residuals,
            goal,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Photographs:
    """Photographs of one pose: their ``views``, each tied to the first; none of no goal."""

    views: tuple[TiedView, ...] = ()

    @classmethod
    def of(cls, image: Image, matcher: Matcher, canvas: Canvas = PLANE) -> 'Photographs':
        """Return ``image`` alone, or raise as ``desired_view`` does."""
        return cls((TiedView.first(desired_view(image, matcher, canvas=canvas)),))

    def __len__(self) -> int:
        return len(self.views)

    @property
    def images(self) -> tuple[Image, ...]:
        """The images, uint8 of shape (H, W), that of the goal first."""
        return tuple(each.view.canvas.image_of(each.view.image) for each in self.views)

    def on_canvas(self, canvas: Canvas) -> 'Photographs':
        """
        Return the same images, at least one, on another ``canvas``, that of another camera.

        Raises ValueError or TrackingError if it cannot use one of them.
        """
        first, *others = self.images
        photographs = Photographs.of(first, self.views[0].view.matcher, canvas)
        for image in others:
            photographs = photographs.with_added(image)
        return photographs

    def with_added(self, image: Image) -> 'Photographs':
        """
        Return these and ``image``, of the same pose in other light.

        Raises ValueError or TrackingError if it cannot be used, is of another pose, or the first.
        """
        if not self.views:
            raise ValueError('no desired image yet; set the one that defines the goal first')
        first = self.views[0]
        view = desired_view(image, first.view.matcher, canvas=first.view.canvas)
        return Photographs((*self.views, tied(view, first, self._free_ids(view.image))))

    def renewed(self, image: Image, most: int) -> 'Photographs':
        """
        Return these and ``image``, of today's light, or these alone if one of them is like it.

        Of more than ``most`` the one that differs least in light is left out, never the first.
        Raises as ``with_added`` does.
        """
        images = [*self.images, as_gray(image)]
        out = superfluous(images, most)
        if out == len(self):
            return self
        views = self.with_added(image).views
        return Photographs(tuple(view for k, view in enumerate(views) if k != out))

    def best_match(
        self, numbers: Sequence[int], image: Image, enough: int | None
    ) -> tuple[int, Matches]:
        """
        Return which of those ``numbers`` has most matches in ``image``, and these.

        The earlier of equal ones; ``enough`` is the number with which quick matches are good
        enough, None of none. Raises the first's TrackingError if none matches.
        """
        current = CurrentView(image)
        found: list[tuple[int, Matches]] = []
        errors: list[TrackingError] = []
        for number in numbers:
            try:
                found.append((number, match_as_needed(self.views[number].view, current, enough)))
            except TrackingError as error:
                errors.append(error)
        if not found:
            raise errors[0]
        return max(found, key=lambda item: len(item[1].indices))

    def _free_ids(self, image: Image) -> int:
        """
        Return the first id of ``image``, which follows from what it shows.

        So that a memory never takes its features for those of one that was left out, nor after
        a start that has other photographs than the last one.
        """
        taken = {view.first_id for view in self.views}
        slot = goal_id(image) % SLOTS
        while IDS * (1 + slot) in taken:
            slot = (slot + 1) % SLOTS
        return IDS * (1 + slot)


class Rematching:
    """Matching of whole images: when it is time for the next, and with which photographs."""

    def __init__(self) -> None:
        self.count = 0
        self._elapsed: int | None = None  # frames since the last one, None of none

    def forget(self) -> None:
        """Forget the last one: of the next image nothing is known."""
        self._elapsed = None

    def pass_frame(self) -> None:
        """Let a frame pass."""
        if self._elapsed is not None:
            self._elapsed += 1

    def is_due(self, left: int, period: int) -> bool:
        """Return whether it is time, with ``left`` features: it takes as long as many frames."""
        return self._elapsed is None or self._elapsed >= (FEW_PERIOD if left < FEW else period)

    def matches(
        self, tracked: tuple[Photographs, int], left: int, image: Image, enough: int
    ) -> tuple[int, Matches]:
        """
        Return which of the photographs has most matches in ``image``, and these.

        All of them are matched where nothing is known, and not quickly; otherwise the one of that
        number which is ``tracked``, and another in turn where few features are ``left``. Raises
        TrackingError if none matches.
        """
        (photographs, number), is_first = tracked, self._elapsed is None
        numbers, others = [number], len(photographs) - 1
        if is_first:
            numbers = list(range(len(photographs)))
        elif others and left < FEW:
            numbers.append((number + 1 + self.count % others) % len(photographs))
        self._elapsed, self.count = 0, self.count + 1
        return photographs.best_match(numbers, image, None if is_first else enough)


def superfluous(images: Sequence[Image], most: int) -> int | None:
    """
    Return which of ``images`` of one pose tells least of other light, None if all may stay.

    Images are uint8 of shape (H, W). The first always stays; the last, new, goes if one is ALIKE.
    Where there are more than ``most``, the older of the two most alike goes.
    """
    small = np.array([_reduced(image) for image in images])
    correlation = small @ small.T
    newest = len(images) - 1
    if newest == 0:
        return None
    if most == 1 or correlation[newest, :newest].max() > ALIKE:
        return newest
    if len(images) <= most:
        return None
    older, newer = max(combinations(range(len(images)), 2), key=lambda pair: correlation[pair])
    return older or newer


def _reduced(image: Image) -> FloatArray:
    """Return the logarithms of ``image`` reduced to SIZE, zero mean and unit norm, flat."""
    small = cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA).ravel().astype(np.float64)
    small = np.log(small + DARK_GREY)
    small -= small.mean()
    return np.asarray(small / max(float(np.linalg.norm(small)), 1e-9))


def tied(view: DesiredView, first: TiedView, first_id: int) -> TiedView:
    """
    Return ``view``, with ids from ``first_id`` on, tied to the ``first`` photograph of its goal.

    Raises ValueError if it is of another size, and TrackingError if it does not show what the
    first one does, or from another place.
    """
    shape = first.view.image.shape
    if view.image.shape != shape:
        raise ValueError(
            f'a further photograph must have the size of the first, {shape[1]}x{shape[0]}, got '
            f'{view.image.shape[1]}x{view.image.shape[0]}; take both with one camera'
        )
    anchor = Anchor(view.image)
    rows, pixels = _mapped(view, _common(view, anchor, first))
    shown = inside_border(pixels, shape, anchor.radius + BORDER)
    rows, pixels = rows[shown], pixels[shown]
    view = replace(view, keypoints=view.keypoints.take(rows), corners=view.corners[rows])
    return TiedView(view, anchor, pixels, first_id)


def _common(view: DesiredView, anchor: Anchor, first: TiedView) -> Warps:
    """Return the warps of the features of ``view`` that the ``first`` photograph shows as well."""
    image = first.view.image
    try:
        matches = match(view, image)
    except TrackingError:
        raise TrackingError(
            f'the photograph does not show what the first one of this goal does; {REMEDY}'
        ) from None
    warps = warps_of(matches, view)
    alignment = anchor.align(warps, float_image(image), iterations=FIRST_ITERATIONS)
    return alignment.warps.take(alignment.correlation >= MIN_CORRELATION)


def _mapped(view: DesiredView, common: Warps) -> tuple[IntArray, FloatArray]:
    """
    Return the keypoints of ``view`` that can be tied, (M,), and where the first has them, (M, 2).

    All, as what is common moves around each, where photographs of one place leave nothing else;
    otherwise those that both show, where each was found. Raises TrackingError if the places are
    too far apart.
    """
    width = view.image.shape[1]
    common, motion = _agreed(common)
    off = np.hypot(*(common.current - motion.applied(common.desired)).T)
    shift = float(np.median(np.hypot(*(common.current - common.desired).T)))
    parallax = float(np.median(off))
    if shift > MAX_SHIFT * width or parallax > MAX_PARALLAX * width:
        raise TrackingError(
            f'the photograph was taken from another pose than the first one of this goal: '
            f'features are shifted by {shift:.1f} px, at most {MAX_SHIFT * width:.1f} are '
            f'allowed, and by {parallax:.2f} px against those around them, at most '
            f'{MAX_PARALLAX * width:.2f}; {REMEDY}'
        )
    if parallax <= ONE_PLACE * width:
        # A smoother map would take parallax of a millimetre out of the pixels, and lead the robot
        # to the other place.
        pixels = view.keypoints.pixels
        return np.arange(len(pixels)), motion.applied(pixels, NEAR_PX, power=2.0)
    kept = off <= EPIPOLAR_PX + OUTLIER_MEDIANS * parallax
    return common.ids[kept], common.current[kept]


def _agreed(common: Warps) -> tuple[Warps, ImageMotion]:
    """Return what moves alike from a photograph to the first, and how; TrackingError of few."""
    motion = fit_motion(common.desired, common.current)
    if motion is not None:
        common = common.take(~motion.outliers(common.desired, common.current, EPIPOLAR_PX))
        motion = fit_motion(common.desired, common.current)
    if motion is None or len(common) < MIN_COMMON:
        raise TrackingError(
            f'the photograph has {len(common)} features in common with the first one of this '
            f'goal, at least {MIN_COMMON} are needed; {REMEDY}, or in light between both'
        )
    return common, motion


def averaged(images: Sequence[Image]) -> Image:
    """Return the mean of ``images``, uint8 of shape (H, W) each, rounded."""
    if len(images) == 1:
        return images[0]
    total = np.zeros(images[0].shape, np.uint32)
    for image in images:
        total += image
    return ((total + len(images) // 2) // len(images)).astype(np.uint8)


def at_rest(images: Sequence[Image]) -> tuple[int, str]:
    """
    Return how many of ``images``, the first and those after it, show one view.

    And what the next one shows of motion, '' if there is none.
    """
    for count, image in enumerate(images[1:], 1):
        reason = unrest(images[0], image)
        if reason:
            return count, reason
    return len(images), ''


def unrest(first: Image, second: Image) -> str:
    """Return what moves from one image to another, in words; '' if that is noise and light."""
    if first.shape != second.shape:
        return 'their sizes differ'
    if min(first.shape) < 3:
        return ''  # no slopes: no photograph either
    difference, columns = _difference(first, second)
    scale = np.maximum(np.abs(columns).max(axis=0), 1e-9)
    rows = columns / scale
    fit = linear_fit(rows, difference, ridge=RIDGE * len(rows))
    residual = np.abs(fit.residual)
    noise = deviation_of(float(np.median(residual)))
    errors = noise * np.sqrt(np.diag(fit.covariance())) / scale
    motion = _at_border((fit.solution / scale)[:MOTIONS])
    # At the border of the image, that blurs less than tracking errs.
    if motion > ROUND_TRIP_PX + NOISE_DEVIATIONS * _at_border(errors[:MOTIONS]):
        return f'the view moves by {motion:.2g} px'
    share = float((residual > CHANGED_DEVIATIONS * noise + CHANGED_FLOOR).mean())
    return f'{share:.1%} of the view changes' if share > CHANGED_SHARE else ''


def _at_border(motion: FloatArray) -> float:
    """Return how far shift, zoom and roll, (4,), move a pixel at the border of the image [px]."""
    return float(np.hypot(*motion[:2]) + np.hypot(*motion[2:]))


def _difference(first: Image, second: Image) -> tuple[FloatArray, FloatArray]:
    """Return differences, (N,), of sampled pixels, and what explains them, (N, 6), see MOTIONS."""
    height, width = first.shape
    stride = max(int(np.sqrt(height * width / SAMPLES)), 1)
    rows, cols = np.arange(1, height - 1, stride), np.arange(1, width - 1, stride)
    mean = 0.5 * (first.astype(np.float32) + second)
    here = np.ix_(rows, cols)
    slope_x = 0.5 * (mean[np.ix_(rows, cols + 1)] - mean[np.ix_(rows, cols - 1)])
    slope_y = 0.5 * (mean[np.ix_(rows + 1, cols)] - mean[np.ix_(rows - 1, cols)])
    half = 0.5 * max(height, width)
    x = ((cols - 0.5 * (width - 1)) / half)[None, :]
    y = ((rows - 0.5 * (height - 1)) / half)[:, None]
    columns = [
        slope_x,
        slope_y,
        x * slope_x + y * slope_y,
        x * slope_y - y * slope_x,
        mean[here],
        np.ones_like(slope_x),
    ]
    difference = first[here].astype(np.float64) - second[here]
    return difference.ravel(), np.stack([item.ravel() for item in columns], axis=1)
