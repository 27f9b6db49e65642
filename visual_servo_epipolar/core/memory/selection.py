"""Selection: which views become keyframes, and which keyframes and features are let go."""

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.memory.refinement import Geometry
from visual_servo_epipolar.core.memory.sightings import MemorySettings
from visual_servo_epipolar.core.memory.window import Window

NEW_SHARE = 0.1  # of the sightings of a view that are of features not remembered
FEWEST_NEW = 3
MIN_KEYFRAME_FEATURES = 8
CLOSEST = 1e-3  # distance that keyframes count as apart at least, in depths of the scene


def depth_of(geometry: Geometry) -> float:
    """Return the median depth of trusted features [m]."""
    near = geometry.unknowns.nearness[geometry.trusted]
    return float(1.0 / max(np.median(near), 1e-6)) if len(near) else 1.0


def is_keyframe(
    geometry: Geometry, pose: FloatArray, *, sightings: int, new: int, settings: MemorySettings
) -> bool:
    """Whether a view at ``pose`` tells what others do not: from elsewhere, or of new features."""
    if sightings < MIN_KEYFRAME_FEATURES:
        return False
    offset = geometry.unknowns.views[:, :2] - pose[:2]
    apart = float(np.hypot(offset[:, 0], offset[:, 1]).min()) / depth_of(geometry)
    return apart > settings.spread or new >= max(FEWEST_NEW, NEW_SHARE * sightings)


def crowded(places: FloatArray, seen: BoolArray, depth: float) -> int:
    """
    Return the keyframe that tells least beside the others: near to them, or with few features.

    ``places`` have shape (K, 2), ``seen`` (K, N). The newest stays.
    """
    offset = (places[:, None] - places) / depth
    square = (offset * offset).sum(-1) + CLOSEST**2
    np.fill_diagonal(square, np.inf)
    share = seen.sum(1) / max(seen.sum(1).max(), 1)
    crowding = (1.0 / square).sum(1) / np.maximum(share, 1e-3) ** 2
    return int(crowding[:-1].argmax())


def kept_features(window: Window, trusted: BoolArray, most: int) -> BoolArray:
    """Return which features are kept, (N,): those in view of a keyframe, the most seen first."""
    count = window.seen.sum(0)
    kept = np.asarray(count > 0)
    if int(kept.sum()) <= most:
        return kept
    rank = np.lexsort((-np.arange(len(count)), count * trusted, kept))
    best = np.zeros(len(count), bool)
    best[rank[-most:]] = True
    return np.asarray(best & kept)
