"""
Reacquisition: lost features are predicted, then searched for by correlation.

No geometry is needed. A feature lost a moment ago is looked for at its predicted position; one
lost for long where a local affine map from the desired to the current image, fitted to its nearest
tracked neighbours, puts it. The scatter of the neighbours sets the search radius.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.tracking.alignment.sampling import FloatImage
from visual_servo_epipolar.core.tracking.alignment.template_alignment import Anchor
from visual_servo_epipolar.core.tracking.alignment.warps import Warps
from visual_servo_epipolar.core.tracking.canvas import Canvas, PLANE
from visual_servo_epipolar.core.tracking.predicted_features import MAX_UNSEEN, PredictedFeatures

NEIGHBOURS = 8
MIN_NEIGHBOURS = 5
RADIUS_DEVIATIONS = 3.0  # search radius, in deviations of the neighbours from their affine map
SEARCH_RANGE = (4.0, 24.0)  # smallest and largest search radius [px]
DISTANCE_FLOOR = 100.0  # squared distance at which a neighbour's weight levels off [px^2]
MIN_PEAK = 0.8  # correlation of a match
MAX_RIVAL = 0.9  # largest ratio of the second peak to the first
PEAK_RADIUS = 4  # half side of one peak [px]
RADIUS_GROWTH = 0.3  # of a predicted feature's search radius [px a frame]


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """
    Predicted warp of a lost feature.

    ``current`` pixel, shape (2,); ``affine`` map of offsets, shape (2, 2); search ``radius`` [px].
    """

    current: FloatArray
    affine: FloatArray
    radius: float


def predict(desired: FloatArray, tracked: Warps, canvas: Canvas = PLANE) -> Prediction | None:
    """
    Predict the feature at ``desired``, shape (2,) [px], from its nearest ``tracked`` neighbours.

    Returns None where they are too few, or scatter so much that the radius would be too large.
    """
    if len(tracked) < MIN_NEIGHBOURS:
        return None
    offsets = canvas.beside(tracked.desired, desired) - desired
    squared = (offsets**2).sum(axis=1)
    near = np.argsort(squared, kind='stable')[:NEIGHBOURS]
    rows = np.column_stack([offsets[near], np.ones(len(near))])
    current = tracked.current[near]
    current = canvas.beside(current, current[0])
    solution = np.linalg.lstsq(rows, current, rcond=None)[0]
    scatter = np.sqrt(((rows @ solution - current) ** 2).sum(axis=1).mean())
    radius = RADIUS_DEVIATIONS * float(scatter) + SEARCH_RANGE[0]
    if radius > SEARCH_RANGE[1]:
        return None
    weight = 1.0 / (squared[near] + DISTANCE_FLOOR)
    affine = np.einsum('n,nij->ij', weight / weight.sum(), tracked.affine[near])
    return Prediction(solution[2], affine, radius)


def search(
    feature: int, desired: FloatArray, prediction: Prediction, anchor: Anchor, image: FloatImage
) -> FloatArray | None:
    """
    Return the current pixel, shape (2,), that correlates best with the desired patch.

    The patch is that of ``feature`` at ``desired``, shape (2,) [px]; ``image`` is float32 of shape
    (H, W). Returns None where the peak is low, or a second one nearly as high.
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
    """
    Return the warps of those ``predicted`` features that are in ``image``, to be aligned yet.

    ``image`` is float32 of shape (H, W).
    """
    rows: list[int] = []
    pixels: list[FloatArray] = []
    affines: list[FloatArray] = []
    for row, feature in enumerate(predicted.warps.ids):
        prediction = _prediction(predicted, row, tracked, canvas)
        if prediction is None or not _inside(prediction.current, image, anchor.radius):
            continue
        pixel = search(int(feature), predicted.warps.desired[row], prediction, anchor, image)
        if pixel is not None:
            rows.append(row)
            pixels.append(pixel)
            affines.append(prediction.affine)
    return replace(
        predicted.warps.take(np.array(rows, dtype=np.int64)),
        current=np.array(pixels).reshape(-1, 2),
        affine=np.array(affines).reshape(-1, 2, 2),
    )


def _prediction(
    predicted: PredictedFeatures, row: int, tracked: Warps, canvas: Canvas
) -> Prediction | None:
    """Return the prediction carried on from frame to frame, or by neighbours where it is old."""
    warps, unseen = predicted.warps, predicted.unseen[row]
    if unseen > MAX_UNSEEN:
        return predict(warps.desired[row], tracked, canvas)
    radius = SEARCH_RANGE[0] + RADIUS_GROWTH * float(unseen)
    return Prediction(warps.current[row], warps.affine[row], radius)


def _inside(pixel: FloatArray, image: FloatImage, border: int) -> bool:
    height, width = image.shape
    u, v = float(pixel[0]), float(pixel[1])
    return bool(border <= u < width - border and border <= v < height - border)
