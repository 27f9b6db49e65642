"""Time of the tracker per frame, beside bare pyramidal Lucas-Kanade on the same images."""

from collections.abc import Sequence
from time import perf_counter, process_time
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.flow import CRITERIA, Points
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker

FLOOR_FIGURES = (
    'tracker_ms',
    'floor_ms',
    'ratio_low',
    'ratio',
    'ratio_high',
    'ratio_worst',
    'worst_ms',
    'features',
)
QUARTILES = (25, 50, 75, 100)
PERIOD = 5  # frames between two anchorings of the run that shows frames with and without


def times(desired: Image, images: Sequence[Image], *, single: bool) -> list[dict[str, Any]]:
    """Return medians [ms] over images, shape (H, W), on all threads and, if ``single``, on one."""
    threads = cv2.getNumThreads()
    counts = dict.fromkeys((threads, 1) if single else (threads,))
    try:
        return [_times(desired, images, count) for count in counts]
    finally:
        cv2.setNumThreads(threads)


def _times(desired: Image, images: Sequence[Image], threads: int) -> dict[str, Any]:
    cv2.setNumThreads(threads)
    # The tracker counts images from one and anchors every PERIOD-th.
    anchored = (np.arange(len(images)) + 1) % PERIOD == 0
    sometimes = _pairs(desired, images, TrackerSettings(anchor_period=PERIOD))
    always = _pairs(desired, images, TrackerSettings(anchor_period=1))
    never = _pairs(desired, images, TrackerSettings(anchor_period=0))
    return {
        'threads': threads,
        'without': _ratio(sometimes[~anchored]),
        'with': _ratio(sometimes[anchored]),
        'every': _ratio(always),
        'never': _ratio(never),
    }


def _pairs(desired: Image, images: Sequence[Image], settings: TrackerSettings) -> FloatArray:
    """Return, shape (N, 3), seconds of tracker and of bare OpenCV, and features of each image."""
    tracker = Tracker(settings)
    tracker.set_desired(desired)
    rows = np.full((len(images), 3), np.nan)
    features = tracker.track(images[0])
    for k in range(1, len(images)):
        before = features
        if k % 2:  # by turns, so that neither always finds the image in the cache
            bare = _lucas_kanade(images[k - 1], images[k], before, settings)
        start = perf_counter()
        features = tracker.track(images[k])
        duration = perf_counter() - start
        if not k % 2:
            bare = _lucas_kanade(images[k - 1], images[k], before, settings)
        if not (features.ages == 0).any():  # a match of the whole image is another matter
            rows[k] = duration, bare, len(before)
    return rows


def _lucas_kanade(
    last: Image, image: Image, features: Features, settings: TrackerSettings
) -> float:
    points = features.current.astype(np.float32)
    if not len(points):
        return float('nan')
    start = perf_counter()
    _bare(last, image, points, settings)
    return perf_counter() - start


def _bare(last: Image, image: Image, points: Points, settings: TrackerSettings) -> None:
    window = settings.window, settings.window
    cv2.calcOpticalFlowPyrLK(
        last, image, points, None, winSize=window, maxLevel=settings.levels, criteria=CRITERIA
    )


def _ratio(rows: FloatArray) -> dict[str, float | None]:
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        return dict.fromkeys(('tracker_ms', 'bare_ms', 'ratio', 'features'))
    tracker, bare, features = np.median(rows, axis=0)
    return {
        'tracker_ms': 1e3 * float(tracker),
        'bare_ms': 1e3 * float(bare),
        'ratio': float(tracker / bare),
        'features': float(features),
    }


def over_floor(desired: Image, images: Sequence[Image]) -> dict[str, Any]:
    """
    Return the anchored tracker's time of a frame over that of one pyramid and one bare flow.

    Processor time on one thread, the two by turns on the same images, shape (H, W), and features;
    medians [ms], and of the ratio the quartiles and the worst frame. A frame in which the whole
    image is matched is another matter.
    """
    threads, settings = cv2.getNumThreads(), TrackerSettings()
    cv2.setNumThreads(1)
    try:
        rows = _floor_rows(desired, images, settings)
    finally:
        cv2.setNumThreads(threads)
    height, width = desired.shape
    document: dict[str, Any] = {'size': [width, height], 'frames': len(rows)}
    if not len(rows):
        return document | dict.fromkeys(FLOOR_FIGURES)
    ratio = rows[:, 0] / rows[:, 1]
    tracker, floor, features = np.median(rows, axis=0)
    figures = 1e3 * tracker, 1e3 * floor, *np.percentile(ratio, QUARTILES), 1e3 * rows[:, 0].max()
    return document | dict(zip(FLOOR_FIGURES, map(float, (*figures, features)), strict=True))


def _floor_rows(desired: Image, images: Sequence[Image], settings: TrackerSettings) -> FloatArray:
    """Return seconds of the tracker and of the floor, and features, of each frame, (N, 3)."""
    tracker = Tracker(settings)
    tracker.set_desired(desired)
    rows, features = [], tracker.track(images[0])
    for k in range(1, len(images)):
        points, matchings = features.current.astype(np.float32), tracker.matchings
        floor = _floor(images[k - 1], images[k], points, settings) if k % 2 else 0.0
        start = process_time()
        features = tracker.track(images[k])
        seconds = process_time() - start
        if not k % 2:
            floor = _floor(images[k - 1], images[k], points, settings)
        if len(points) and tracker.matchings == matchings:
            rows.append((seconds, floor, len(points)))
    return np.array(rows).reshape(-1, 3)


def _floor(last: Image, image: Image, points: Points, settings: TrackerSettings) -> float:
    """Return the processor time [s] of a pyramid of ``image`` and the flow of ``points``."""
    if not len(points):
        return 0.0
    window = settings.window, settings.window
    start = process_time()
    cv2.buildOpticalFlowPyramid(image, window, settings.levels, withDerivatives=False)
    _bare(last, image, points, settings)
    return process_time() - start
