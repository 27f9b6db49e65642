"""Scores of the tracking benchmark: errors en route and at the goal, gross ones one by one."""

from collections.abc import Sequence
import math
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.evaluation.benchmarks.tracking.world import (
    FrameErrors,
    STANDING,
    TrueFeatures,
)

GROSS = 3.0  # a feature farther than this from its place is a wrong one [px]
ENOUGH = 26  # features of the paper's experiments


def scores(truth: TrueFeatures, frames: Sequence[FrameErrors]) -> dict[str, Any]:
    """
    Return the figures of one run.

    Errors are those of trackable features. A gross error is a feature reported as good, off the
    edges of depth, more than GROSS from its place, whether or not that place is hidden: nothing
    flagged it. Those on edges of depth are counted apart, for they have no single true place.
    """
    route, goal = frames[:-STANDING], frames[-STANDING:]
    counts = np.array([len(frame_errors.features) for frame_errors in frames])
    gross = [_gross(frame_errors) for frame_errors in frames]
    edges = _pool(frames, lambda frame: frame.on_edge)
    counted = int(counts.sum()) - len(edges)
    return {
        'route_px': _median(_pool(route, lambda frame: frame.trackable)),
        'route_p95_px': _percentile(_pool(route, lambda frame: frame.trackable), 95.0),
        'goal_px': _median(_pool(goal, lambda frame: frame.trackable)),
        'goal_p95_px': _percentile(_pool(goal, lambda frame: frame.trackable), 95.0),
        'gross': sum(int(rows.sum()) for rows in gross),
        'gross_share': sum(int(rows.sum()) for rows in gross) / max(counted, 1),
        'gross_share_worst': max(
            (rows.mean() if len(rows) else 0.0 for rows in gross), default=0.0
        ),
        'gross_tracks': episodes(frames, gross),
        'edge_share': len(edges) / max(int(counts.sum()), 1),
        'edge_px': _median(edges),
        'edge_gross': int((edges > GROSS).sum()),
        'fewest': int(counts.min()),
        'fewest_places': min(map(places, frames)),
        'few_frames': np.flatnonzero(counts < ENOUGH).tolist(),
        'fewest_open': min(int(frame_errors.trackable.sum()) for frame_errors in frames),
        'redetections': redetections(frames),
        **_pose_errors(truth, goal),
    }


def places(frame_errors: FrameErrors) -> int:
    """Count the features at different places: two at one pixel tell no more than one."""
    return len(np.unique(np.rint(frame_errors.features.desired), axis=0))


def redetections(frames: Sequence[FrameErrors]) -> list[int]:
    """Return the frames after the first one in which features came in anew."""
    ages = [frame_errors.features.ages for frame_errors in frames]
    return [frame for frame, age in enumerate(ages) if frame and (age == 0).any()]


def ended_tracks(before: FrameErrors, features: Features) -> Features:
    """Return the tracks of the frame ``before`` that were right and are not in ``features``."""
    tracks = before.features
    rows = ~np.isin(tracks.ids, features.ids) & (before.distances <= GROSS)
    return Features(
        tracks.ids[rows],
        tracks.current[rows],
        tracks.desired[rows],
        tracks.ages[rows],
        tracks.errors[rows],
    )


def episodes(frames: Sequence[FrameErrors], gross: Sequence[BoolArray]) -> list[dict[str, Any]]:
    """Return one entry for each feature with gross errors; ``gross`` has shape (N,) by frame."""
    entries: dict[int, dict[str, Any]] = {}
    for frame, (frame_errors, rows) in enumerate(zip(frames, gross, strict=True)):
        for row in np.flatnonzero(rows).tolist():
            features, error = frame_errors.features, float(frame_errors.distances[row])
            entry = entries.setdefault(
                int(features.ids[row]),
                {
                    'id': int(features.ids[row]),
                    'first': frame,
                    'age': int(features.ages[row]),
                    'desired': features.desired[row].tolist(),
                    'current': features.current[row].tolist(),
                    'edge_within_px': _or_none(float(frame_errors.clearance[row])),
                    'frames': 0,
                    'hidden': 0,
                    'covered': 0,
                    'largest_px': 0.0,
                },
            )
            entry['last'] = frame
            entry['frames'] += 1
            entry['hidden'] += int(not frame_errors.visible[row])
            entry['covered'] += int(frame_errors.covered[row])
            entry['residual'] = float(features.errors[row])
            entry['largest_px'] = max(entry['largest_px'], _or_none(error) or 1e6)
    return list(entries.values())


def recovery_time(frames: Sequence[FrameErrors], first: int) -> int | None:
    """Return how many frames after ``first`` there are enough features for good; None: never."""
    few = [
        frame
        for frame, frame_errors in enumerate(frames)
        if frame >= first and len(frame_errors.features) < ENOUGH
    ]
    if not few:
        return 0
    return None if few[-1] == len(frames) - 1 else few[-1] + 1 - first


def _gross(frame_errors: FrameErrors) -> BoolArray:
    return np.asarray(~frame_errors.on_edge & (frame_errors.distances > GROSS))


def _pool(frames: Sequence[FrameErrors], choose: Any) -> FloatArray:
    """Return the errors of the features that ``choose`` takes, of all frames."""
    chosen = [frame_errors.distances[choose(frame_errors)] for frame_errors in frames]
    return np.concatenate([*chosen, np.empty(0)])


def _pose_errors(truth: TrueFeatures, goal: Sequence[FrameErrors]) -> dict[str, float | None]:
    errors = [error for error in map(truth.pose_error, goal) if error is not None]
    names = ('pose_x_mm', 'pose_y_mm', 'pose_heading_deg')
    if not errors:
        return dict.fromkeys(names)
    typical = np.abs(np.array(errors)).mean(axis=0) * [1e3, 1e3, math.degrees(1.0)]
    return dict(zip(names, typical.tolist(), strict=True))


def _median(values: FloatArray) -> float | None:
    return _percentile(values, 50.0)


def _percentile(values: FloatArray, share: float) -> float | None:
    return float(np.percentile(values, share)) if len(values) else None


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None
