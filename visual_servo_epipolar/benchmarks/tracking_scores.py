"""What the tracking benchmark counts: errors en route and at the goal, gross ones one by one."""

from collections.abc import Sequence
import math
from typing import Any

import numpy as np

from visual_servo_epipolar.benchmarks.tracking_world import Judgement, STANDING, Truth
from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.tracking.features import Features

GROSS = 3.0  # a feature farther than this from its place is a wrong one [px]
ENOUGH = 26  # features of the paper's experiments


def scores(truth: Truth, judgements: Sequence[Judgement]) -> dict[str, Any]:
    """
    Return the figures of one run.

    Errors are those of open features. A gross error is a feature handed on as good, off the edges
    of depth, more than GROSS from its place, whether or not that place is hidden: nothing flagged
    it. Those on edges of depth are counted apart, for they have no single true place.
    """
    route, goal = judgements[:-STANDING], judgements[-STANDING:]
    counts = np.array([len(judgement.features) for judgement in judgements])
    gross = [_gross(judgement) for judgement in judgements]
    edges = _pooled(judgements, lambda judgement: judgement.on_edge)
    judged = int(counts.sum()) - len(edges)
    return {
        'route_px': _median(_pooled(route, lambda judgement: judgement.open)),
        'route_p95_px': _percentile(_pooled(route, lambda judgement: judgement.open), 95.0),
        'goal_px': _median(_pooled(goal, lambda judgement: judgement.open)),
        'goal_p95_px': _percentile(_pooled(goal, lambda judgement: judgement.open), 95.0),
        'gross': sum(int(rows.sum()) for rows in gross),
        'gross_share': sum(int(rows.sum()) for rows in gross) / max(judged, 1),
        'gross_share_worst': max(
            (rows.mean() if len(rows) else 0.0 for rows in gross), default=0.0
        ),
        'gross_tracks': episodes(judgements, gross),
        'edge_share': len(edges) / max(int(counts.sum()), 1),
        'edge_px': _median(edges),
        'edge_gross': int((edges > GROSS).sum()),
        'fewest': int(counts.min()),
        'fewest_places': min(map(places, judgements)),
        'few_frames': np.flatnonzero(counts < ENOUGH).tolist(),
        'fewest_open': min(int(judgement.open.sum()) for judgement in judgements),
        'redetections': redetections(judgements),
        **_pose_errors(truth, goal),
    }


def places(judgement: Judgement) -> int:
    """Count the features at different places: two at one pixel tell no more than one."""
    return len(np.unique(np.rint(judgement.features.desired), axis=0))


def redetections(judgements: Sequence[Judgement]) -> list[int]:
    """Return the frames after the first one in which features came in anew."""
    ages = [judgement.features.ages for judgement in judgements]
    return [frame for frame, age in enumerate(ages) if frame and (age == 0).any()]


def ended(before: Judgement, features: Features) -> Features:
    """Return the tracks of the frame ``before`` that were right and are not in ``features``."""
    was = before.features
    rows = ~np.isin(was.ids, features.ids) & (before.errors <= GROSS)
    return Features(
        was.ids[rows], was.current[rows], was.desired[rows], was.ages[rows], was.errors[rows]
    )


def episodes(judgements: Sequence[Judgement], gross: Sequence[BoolArray]) -> list[dict[str, Any]]:
    """Return one entry for each feature with gross errors: since when, how far, why perhaps."""
    found: dict[int, dict[str, Any]] = {}
    for frame, (judgement, rows) in enumerate(zip(judgements, gross, strict=True)):
        for row in np.flatnonzero(rows).tolist():
            features, error = judgement.features, float(judgement.errors[row])
            entry = found.setdefault(
                int(features.ids[row]),
                {
                    'id': int(features.ids[row]),
                    'first': frame,
                    'age': int(features.ages[row]),
                    'desired': features.desired[row].tolist(),
                    'current': features.current[row].tolist(),
                    'edge_within_px': _or_none(float(judgement.clearance[row])),
                    'frames': 0,
                    'hidden': 0,
                    'covered': 0,
                    'largest_px': 0.0,
                },
            )
            entry['last'] = frame
            entry['frames'] += 1
            entry['hidden'] += int(not judgement.seen[row])
            entry['covered'] += int(judgement.covered[row])
            entry['residual'] = float(features.errors[row])
            entry['largest_px'] = max(entry['largest_px'], _or_none(error) or 1e6)
    return list(found.values())


def recovered(judgements: Sequence[Judgement], first: int) -> int | None:
    """Return how many frames after ``first`` there are enough features for good; None: never."""
    few = [
        frame
        for frame, judgement in enumerate(judgements)
        if frame >= first and len(judgement.features) < ENOUGH
    ]
    if not few:
        return 0
    return None if few[-1] == len(judgements) - 1 else few[-1] + 1 - first


def _gross(judgement: Judgement) -> BoolArray:
    return np.asarray(~judgement.on_edge & (judgement.errors > GROSS))


def _pooled(judgements: Sequence[Judgement], choose: Any) -> FloatArray:
    """Return the errors of the features that ``choose`` takes, of all frames."""
    chosen = [judgement.errors[choose(judgement)] for judgement in judgements]
    return np.concatenate([*chosen, np.empty(0)])


def _pose_errors(truth: Truth, goal: Sequence[Judgement]) -> dict[str, float | None]:
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
