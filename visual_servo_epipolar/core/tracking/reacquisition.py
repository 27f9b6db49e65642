"""
Reacquisition: lost features are predicted, then searched for by correlation.

No geometry is needed. A feature that is lost behind an obstacle, or that left the image, moves on
with the features around it, and is looked for there. One that is lost for long is looked for where
a local affine map from the desired to the current image, fitted to its nearest tracked neighbours,
puts it; their scatter sets the search radius.
"""

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import are_among, BoolArray, FloatArray, IntArray
from visual_servo_epipolar.core.tracking.alignment import Anchor
from visual_servo_epipolar.core.tracking.canvas import Canvas, PLANE
from visual_servo_epipolar.core.tracking.matchers.base import NEIGHBOURS
from visual_servo_epipolar.core.tracking.matching import DesiredView
from visual_servo_epipolar.core.tracking.sampling import FloatImage, inside_border, RADIUS
from visual_servo_epipolar.core.tracking.tracks import fit_motion, ImageMotion, MIN_SUPPORT
from visual_servo_epipolar.core.tracking.warps import Warps

MAX_UNSEEN = 40  # frames for which a prediction is followed
OUTLIER_PX = 8.0  # distance from the motion of most at which a feature is an outlier
NOISE_DEVIATIONS = 3.0  # that noise hardly reaches: of a search, or of a motion
SEARCH_RANGE = (4.0, 24.0)  # smallest and largest search radius [px]
MIN_PEAK = 0.8  # correlation of a match
MAX_RIVAL = 0.9  # largest ratio of the second peak to the first
PEAK_RADIUS = 4  # half side of one peak [px]
RADIUS_GROWTH = 0.3  # of a predicted feature's search radius [px a frame]


class PredictedFeatures(NamedTuple):
    """Last seen or predicted ``warps`` of N candidates; frames ``unseen`` of each, shape (N,)."""

    warps: Warps
    unseen: IntArray


class Predictions:
    """Predictions of a tracker, which follow the last motion not before somebody needs them."""

    def __init__(self) -> None:
        self._features = PredictedFeatures(Warps.empty(), np.empty(0, np.int64))
        self._motion: tuple[ImageMotion | None, IntArray] | None = None  # to be followed yet

    def follow(self, last: Warps, tracked: Warps) -> BoolArray:
        """
        Follow the motion from the ``last`` frame to the M features ``tracked`` in this one.

        These are in the order of the last frame. Returns which move as most do, shape (M,).
        """
        self._catch_up()
        before = last.current
        if len(tracked) < len(last):
            before = before[are_among(last.ids, tracked.ids)]
        motion = fit_motion(before, tracked.current)
        self._motion = motion, tracked.ids
        if motion is None:
            return np.ones(len(tracked), bool)
        return ~motion.outliers(before, tracked.current, OUTLIER_PX)

    def correct(self, tracked: Warps) -> None:
        """Replace or add the predictions of ``tracked`` features."""
        warps, unseen = self._catch_up()
        kept = ~are_among(warps.ids, tracked.ids)
        unseen = np.concatenate([unseen[kept], np.zeros(len(tracked), np.int64)])
        self._features = PredictedFeatures(warps.take(kept).joined(tracked), unseen)

    def select(self, ids: IntArray) -> PredictedFeatures:
        """Return the predictions of the features ``ids``, shape (M,)."""
        warps, unseen = self._catch_up()
        rows = are_among(warps.ids, ids)
        return PredictedFeatures(warps.take(rows), unseen[rows])

    def _catch_up(self) -> PredictedFeatures:
        """
        Follow the last motion; where there was none, predictions become stale.

        Only what is followed moves: not the features tracked, which will be corrected, and not
        what has been out of sight for too long.
        """
        if self._motion is not None:
            (warps, unseen), (motion, tracked) = self._features, self._motion
            if motion is not None:
                lost = ~are_among(warps.ids, tracked) & (unseen <= MAX_UNSEEN)
                current = warps.current.copy()
                current[lost] = motion.applied(current[lost])
                warps = replace(warps, current=current)
            age = MAX_UNSEEN + 1 if motion is None else 1
            self._features, self._motion = PredictedFeatures(warps, unseen + age), None
        return self._features


class Prediction(NamedTuple):
    """Where a lost feature may be: pixel, (2,), map of offsets, (2, 2), search ``radius`` [px]."""

    current: FloatArray
    affine: FloatArray
    radius: float


def predict(desired: FloatArray, tracked: Warps, canvas: Canvas = PLANE) -> Prediction | None:
    """
    Predict the feature at ``desired``, shape (2,) [px], from its nearest ``tracked`` neighbours.

    Returns None where they are too few, or scatter so much that the radius would be too large.
    """
    if len(tracked) < MIN_SUPPORT:
        return None
    offsets = canvas.beside(tracked.desired, desired) - desired
    squared = (offsets**2).sum(axis=1)
    near = np.argsort(squared, kind='stable')[:NEIGHBOURS]
    rows = np.column_stack([offsets[near], np.ones(len(near))])
    current = tracked.current[near]
    current = canvas.beside(current, current[0])
    solution = np.linalg.lstsq(rows, current, rcond=None)[0]
    scatter = np.sqrt(((rows @ solution - current) ** 2).sum(axis=1).mean())
    radius = NOISE_DEVIATIONS * float(scatter) + SEARCH_RANGE[0]
    if radius > SEARCH_RANGE[1]:
        return None
    weight = 1.0 / (squared[near] + RADIUS**2)  # it levels off where patches overlap
    affine = np.einsum('n,nij->ij', weight / weight.sum(), tracked.affine[near])
    return Prediction(solution[2], affine, radius)


def search(
    feature: int, desired: FloatArray, prediction: Prediction, anchor: Anchor, image: FloatImage
) -> FloatArray | None:
    """
    Return the current pixel, shape (2,), that correlates best with the desired patch.

    The patch is that of ``feature`` at ``desired``, shape (2,) [px]. Returns None where the peak
    is low, or a second one nearly as high.
    """
    patch, local = anchor.patch(feature, desired, prediction.affine)
    reach = anchor.radius + int(np.ceil(prediction.radius))
    region = anchor.region(image, prediction.current, local, reach)
    score = cv2.matchTemplate(region, patch, cv2.TM_CCOEFF_NORMED)
    _, peak, _, (column, row) = cv2.minMaxLoc(score)
    if not peak >= MIN_PEAK:
        return None
    rivals = score.copy()
    rivals[
        max(row - PEAK_RADIUS, 0) : row + PEAK_RADIUS + 1,
        max(column - PEAK_RADIUS, 0) : column + PEAK_RADIUS + 1,
    ] = -1.0
    if float(rivals.max()) > MAX_RIVAL * peak:
        return None
    step = np.array([column, row], dtype=np.float64) - (reach - anchor.radius)
    return np.asarray(prediction.current + local @ step)


def reacquire(
    predicted: PredictedFeatures,
    tracked: Warps,
    anchor: Anchor,
    image: FloatImage,
    canvas: Canvas = PLANE,
) -> Warps:
    """Return the warps of ``predicted`` features that are in ``image``, to be aligned yet."""
    warps, rows = predicted.warps, []
    current, affine = warps.current.copy(), warps.affine.copy()
    for row, unseen in enumerate(predicted.unseen.tolist()):
        desired = warps.desired[row]
        prediction: Prediction | None = Prediction(
            warps.current[row], warps.affine[row], SEARCH_RANGE[0] + RADIUS_GROWTH * unseen
        )
        if unseen > MAX_UNSEEN:
            prediction = predict(desired, tracked, canvas)
        if prediction is None:
            continue
        if not inside_border(prediction.current[None], image.shape, anchor.radius)[0]:
            continue
        pixel = search(int(warps.ids[row]), desired, prediction, anchor, image)
        if pixel is not None:
            rows.append(row)
            current[row], affine[row] = pixel, prediction.affine
    return replace(warps, current=current, affine=affine).take(np.array(rows, np.int64))


def among_neighbours(
    found: Warps, view: DesiredView, anchor: Anchor, image: FloatImage, missing: int
) -> Warps:
    """
    Return keypoints of a ``view`` that no descriptor found in ``image``, to be aligned yet.

    Where those ``found`` around them predict: of twice as many as are ``missing``, those of most
    texture.
    """
    ids = np.flatnonzero(~are_among(np.arange(len(view.keypoints)), found.ids))
    ids = ids[view.corners[ids].argsort(kind='stable')[::-1]][: 2 * max(missing, 0)]
    desired = view.keypoints.pixels[ids]
    nowhere = Warps(ids, desired, desired, np.tile(np.eye(2), (len(ids), 1, 1)))
    predicted = PredictedFeatures(nowhere, np.full(len(ids), MAX_UNSEEN + 1))
    return reacquire(predicted, found, anchor, image, view.canvas)
