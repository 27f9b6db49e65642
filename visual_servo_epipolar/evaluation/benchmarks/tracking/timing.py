"""Time of the tracker per frame, beside bare pyramidal Lucas-Kanade on the same images."""

from collections.abc import Callable, Sequence
from time import perf_counter, process_time
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
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
Clock = Callable[[], float]
Bare = Callable[[Image, Image, Points, TrackerSettings], None]
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
    pair = desired, images
    sometimes = _by_turns(*pair, TrackerSettings(anchor_period=PERIOD), perf_counter, _flow)
    always = _by_turns(*pair, TrackerSettings(anchor_period=1), perf_counter, _flow)
    never = _by_turns(*pair, TrackerSettings(anchor_period=0), perf_counter, _flow)
    return {
        'threads': threads,
        'without': _ratio(sometimes[~anchored]),
        'with': _ratio(sometimes[anchored]),
        'every': _ratio(always),
        'never': _ratio(never),
    }


def _by_turns(
    desired: Image, images: Sequence[Image], settings: TrackerSettings, clock: Clock, bare: Bare
) -> FloatArray:
    """
    Return, shape (N, 3), seconds of the tracker and of ``bare``, and features of each image.

    Rows are nan where the tracker matched the whole image, or had nothing to follow.
    """
    tracker = Tracker(settings)
    tracker.set_desired(desired)
    rows, features = np.full((len(images), 3), np.nan), tracker.track(images[0])

    def floor(k: int, points: Points) -> float:
        start = clock()
        bare(images[k - 1], images[k], points, settings)
        return clock() - start

    for k in range(1, len(images)):
        points, matchings = features.current.astype(np.float32), tracker.matchings
        alone = floor(k, points) if k % 2 and len(points) else 0.0  # by turns: neither always
        start = clock()  # finds the image in the cache
        features = tracker.track(images[k])
        seconds = clock() - start
        if not k % 2 and len(points):
            alone = floor(k, points)
        if len(points) and tracker.matchings == matchings:
            rows[k] = seconds, alone, len(points)
    return rows


def _flow(last: Image, image: Image, points: Points, settings: TrackerSettings) -> None:
    window = settings.window, settings.window
    cv2.calcOpticalFlowPyrLK(
        last, image, points, None, winSize=window, maxLevel=settings.levels, criteria=CRITERIA
    )


def _floor(last: Image, image: Image, points: Points, settings: TrackerSettings) -> None:
    window = settings.window, settings.window
    cv2.buildOpticalFlowPyramid(image, window, settings.levels, withDerivatives=False)
    _flow(last, image, points, settings)


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
        rows = _by_turns(desired, images, settings, process_time, _floor)
        rows = rows[np.isfinite(rows).all(axis=1)]
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
