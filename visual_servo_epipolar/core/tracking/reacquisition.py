"""
Features that left the view and come back: predicted by their neighbours, found by correlation.

No geometry is needed: what the nearest tracked features did, as a local affine map from the
desired to the current image, says where to look, and how much they scatter says how far.
"""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.tracking.predicted_features import PredictedFeatures
from visual_servo_epipolar.core.tracking.template_alignment import (
    Anchor,
    FloatImage,
    RADIUS,
    Warps,
)

NEIGHBOURS = 8
MIN_NEIGHBOURS = 5
SCATTERS = 3.0  # search radius, in deviations of the neighbours from their affine map
SEARCH_RANGE = (4.0, 24.0)  # [px]
MIN_PEAK = 0.8  # correlation at the best place
MAX_RIVAL = 0.9  # second best place over the best one
PEAK_RADIUS = 4  # what belongs to one peak [px]
GHOST_DRIFT, GHOST_LIFE = 0.3, 40  # of a guess: growth of its radius [px a frame], frames


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Where a feature may be: current pixel, local map, search radius [px]."""

    current: FloatArray
    affine: FloatArray
    radius: float


def predict(desired: FloatArray, tracked: Warps) -> Prediction | None:
    """
    Predict a feature at ``desired``, shape (2,), from the tracked ones nearest to it.

    Returns None where they are too few, or move so differently that nothing can be said.
    """
    if len(tracked) < MIN_NEIGHBOURS:
        return None
    squared = ((tracked.desired - desired) ** 2).sum(axis=1)
    near = np.argsort(squared, kind='stable')[:NEIGHBOURS]
    offsets = tracked.desired[near] - desired
    rows = np.column_stack([offsets, np.ones(len(near))])
    solution = np.linalg.lstsq(rows, tracked.current[near], rcond=None)[0]
    scatter = np.sqrt(((rows @ solution - tracked.current[near]) ** 2).sum(axis=1).mean())
    radius = SCATTERS * float(scatter) + SEARCH_RANGE[0]
    if radius > SEARCH_RANGE[1]:
        return None
    weight = 1.0 / (squared[near] + 100.0)
    affine = np.einsum('n,nij->ij', weight / weight.sum(), tracked.affine[near])
    return Prediction(solution[2], affine, radius)


def search(
    key: int, desired: FloatArray, guess: Prediction, anchor: Anchor, image: FloatImage
) -> FloatArray | None:
    """Return the current pixel, shape (2,), that looks like the desired patch; None if unsure."""
    patch, local = anchor.patch(key, desired, guess.affine)
    reach = RADIUS + int(np.ceil(guess.radius))
    region = anchor.region(image, guess.current, local, reach)
    score = cv2.matchTemplate(region, patch, cv2.TM_CCOEFF_NORMED)
    _, best, _, (column, row) = cv2.minMaxLoc(score)
    if not best >= MIN_PEAK:
        return None
    around = score.copy()
    around[
        max(row - PEAK_RADIUS, 0) : row + PEAK_RADIUS + 1,
        max(column - PEAK_RADIUS, 0) : column + PEAK_RADIUS + 1,
    ] = -1.0
    if float(around.max()) > MAX_RIVAL * best:
        return None
    step = np.array([column, row], dtype=np.float64) - (reach - RADIUS)
    return np.asarray(guess.current + local @ step)


def found_again(
    predicted: PredictedFeatures, tracked: Warps, anchor: Anchor, image: FloatImage
) -> Warps:
    """
    Return those of the ``predicted`` that are found near where they should be.

    One that was seen a moment ago is looked for where the features around it went since; one that
    was away for long, where its neighbours in the desired image are now.
    """
    height, width = image.shape
    rows: list[int] = []
    places: list[FloatArray] = []
    maps: list[FloatArray] = []
    for row, (key, unseen) in enumerate(zip(predicted.warps.ids, predicted.unseen, strict=True)):
        desired = predicted.warps.desired[row]
        guess: Prediction | None = Prediction(
            predicted.warps.current[row],
            predicted.warps.affine[row],
            SEARCH_RANGE[0] + GHOST_DRIFT * float(unseen),
        )
        if unseen > GHOST_LIFE:
            guess = predict(desired, tracked)
        if guess is None or not _inside(guess.current, width, height):
            continue
        place = search(int(key), desired, guess, anchor, image)
        if place is not None:
            rows.append(row)
            places.append(place)
            maps.append(guess.affine)
    found = predicted.warps.take(np.array(rows, dtype=np.int64))
    return replace(
        found,
        current=np.array(places).reshape(-1, 2),
        affine=np.array(maps).reshape(-1, 2, 2),
    )


def _inside(pixel: FloatArray, width: int, height: int) -> bool:
    u, v = float(pixel[0]), float(pixel[1])
    return RADIUS <= u < width - RADIUS and RADIUS <= v < height - RADIUS
