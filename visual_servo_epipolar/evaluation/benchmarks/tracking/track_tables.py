"""The document of the tracking benchmark as text."""

from collections.abc import Iterator, Mapping
from typing import Any

from visual_servo_epipolar.evaluation.benchmarks.tracking.scores import ENOUGH
from visual_servo_epipolar.evaluation.tables import aligned, number

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


def figures(document: Mapping[str, Any]) -> dict[str, float]:
    """Return what to compare between runs; less is better."""
    return {
        f'{"x".join(map(str, it["size"]))} anchored frame over pyramid and flow': it['ratio']
        for it in document['over_floor']
        if it['ratio'] is not None
    }


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
