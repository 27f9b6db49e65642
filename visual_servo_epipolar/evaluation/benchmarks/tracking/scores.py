"""Scores of the tracking benchmark: errors en route and at the goal, gross ones; as text."""

from collections.abc import Iterator, Mapping, Sequence
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
from visual_servo_epipolar.evaluation.tables import aligned, number

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


CALM = (
    'scene | configuration | en route med p95 | at goal med p95 | gross (tracks) share | fewest '
    '| edges share med gross | pose x y mm, deg | redet. | ms med max'
)
ROUGH = (
    'scene | disturbance | med, during | at goal | gross (tracks) | fewest '
    f'| frames < {ENOUGH} | regained after | given up | redet.'
)
TIMED = {
    'without': 'frames without anchoring',
    'with': 'frames with anchoring, every 5',
    'every': 'anchoring in every frame',
    'never': 'never anchored',
}


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: accuracy, robustness, time."""
    width, height = document['size']
    calm = (
        _calm_row(scene['scene'], name, it)
        for scene in document['scenes']
        for name, it in scene['configurations'].items()
    )
    return '\n'.join(
        [
            f'Tracking, {document["frames"]} rendered frames of {width}x{height} a scene, '
            'errors in px against ground truth',
            '',
            *aligned(CALM, calm, left=2),
            '',
            *aligned(ROUGH, map(_rough_row, document['disturbed']), left=2),
            '',
            *(line for it in document['time'] for line in _time_rows(it)),
            *_floor_rows(document['over_floor']),
        ]
    )


def _px(it: Mapping[str, Any], *names: str) -> str:
    return ' '.join(number(it[name], 3) for name in names)


def _calm_row(scene: int, name: str, it: Mapping[str, Any]) -> list[str]:
    return [
        str(scene),
        name,
        _px(it, 'route_px', 'route_p95_px'),
        _px(it, 'goal_px', 'goal_p95_px'),
        f'{it["gross"]} ({len(it["gross_tracks"])}) {100 * it["gross_share"]:.2f} %',
        f'{it["fewest"]}/{it["fewest_places"]}',
        f'{100 * it["edge_share"]:.0f} % {_px(it, "edge_px")} {it["edge_gross"]}',
        f'{_px(it, "pose_x_mm", "pose_y_mm")} {number(it["pose_heading_deg"], 4)}',
        str(len(it['redetections'])),
        f'{it["frame_ms"]:.1f} {it["slowest_ms"]:.0f}',
    ]


def _rough_row(it: Mapping[str, Any]) -> list[str]:
    back = it['recovered_after']
    return [
        str(it['scene']),
        it['disturbance'],
        _px(it, 'route_px', 'during_px'),
        _px(it, 'goal_px'),
        f'{it["gross"]} ({len(it["gross_tracks"])})',
        f'{it["fewest"]}/{it["fewest_places"]}',
        str(len(it['few_frames'])),
        'never' if back is None else f'{back} frames',
        '+'.join(map(str, it['given_up'])),
        str(len(it['redetections'])),
    ]


def _time_rows(it: Mapping[str, Any]) -> Iterator[str]:
    yield f'time per frame, {it["threads"]} OpenCV threads; ratio to bare calcOpticalFlowPyrLK'
    for key, words in TIMED.items():
        of = it[key]
        tracker, bare, ratio = (number(of[k], 2) for k in ('tracker_ms', 'bare_ms', 'ratio'))
        yield (
            f'  {words:<32}{tracker:>8} ms, bare {bare:>6} ms, ratio {ratio}, '
            f'{number(of["features"], 0)} features'
        )


def _floor_rows(sizes: list[Mapping[str, Any]]) -> Iterator[str]:
    yield 'processor time a frame, anchored, one thread; ratio to one pyramid and one bare flow'
    for it in sizes:
        size = 'x'.join(map(str, it['size']))
        tracker, floor = (number(it[name], 2) for name in ('tracker_ms', 'floor_ms'))
        ratio, low, high, worst = (
            number(it[f'ratio{name}'], 2) for name in ('', '_low', '_high', '_worst')
        )
        yield (
            f'  {size:<10}{tracker:>8} ms, floor {floor} ms, ratio {ratio} (quartiles '
            f'{low} to {high}, worst frame {worst}, {number(it["worst_ms"], 1)} ms)'
        )
