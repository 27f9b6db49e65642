"""The document of the tracking benchmark as text."""

from collections.abc import Mapping, Sequence
from typing import Any

from visual_servo_epipolar.evaluation.benchmarks.tracking.scores import ENOUGH


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: accuracy, robustness, time."""
    width, height = document['size']
    lines = [
        f'Tracking, {document["frames"]} rendered frames of {width}x{height} a scene, '
        'errors in px against ground truth',
        '',
        f'{"scene  configuration":<25}{"en route med p95":>17}{"at goal med p95":>17}'
        f'{"gross (tracks) share":>22}{"fewest":>8}{"edges share med gross":>23}'
        f'{"pose x y mm, deg":>23}{"redet.":>8}{"ms med max":>14}',
    ]
    for scene in document['scenes']:
        for name, it in scene['configurations'].items():
            lines.append(f'{scene["scene"]:<7}{name:<18}' + _row(it))
    lines += ['', _rough_head()]
    lines += [_rough_row(it) for it in document['disturbed']]
    lines += ['', *(line for it in document['time'] for line in _time_rows(it))]
    lines += _floor_rows(document['over_floor'])
    return '\n'.join(lines)


def figures(document: Mapping[str, Any]) -> dict[str, float]:
    """Return what to compare between runs; less is better."""
    return {
        f'{"x".join(map(str, it["size"]))} anchored frame over pyramid and flow': it['ratio']
        for it in document['over_floor']
        if it['ratio'] is not None
    }


def _row(it: Mapping[str, Any]) -> str:
    gross = f'{it["gross"]} ({len(it["gross_tracks"])}) {100 * it["gross_share"]:.2f} %'
    edges = f'{100 * it["edge_share"]:.0f} % {_px(it["edge_px"])} {it["edge_gross"]}'
    pose = f'{_px(it["pose_x_mm"])} {_px(it["pose_y_mm"])} {_px(it["pose_heading_deg"], 4)}'
    return (
        f'{_px(it["route_px"])} {_px(it["route_p95_px"])}'.rjust(17)
        + f'{_px(it["goal_px"])} {_px(it["goal_p95_px"])}'.rjust(17)
        + gross.rjust(22)
        + f'{it["fewest"]}/{it["fewest_places"]}'.rjust(8)
        + edges.rjust(23)
        + pose.rjust(23)
        + f'{len(it["redetections"]):8d}'
        + f'{it["frame_ms"]:.1f} {it["slowest_ms"]:.0f}'.rjust(14)
    )


def _rough_head() -> str:
    return (
        f'{"scene  disturbance":<27}{"med, during":>14}{"at goal":>9}{"gross (tracks)":>16}'
        f'{"fewest":>8}{f"frames < {ENOUGH}":>13}{"regained after":>16}'
        f'{"given up":>12}{"redet.":>8}'
    )


def _rough_row(it: Mapping[str, Any]) -> str:
    back = it['recovered_after']
    hidden, in_view = it['given_up']
    return (
        f'{it["scene"]:<7}{it["disturbance"]:<20}'
        + f'{_px(it["route_px"])} {_px(it["during_px"])}'.rjust(14)
        + _px(it['goal_px']).rjust(9)
        + f'{it["gross"]} ({len(it["gross_tracks"])})'.rjust(16)
        + f'{it["fewest"]}/{it["fewest_places"]}'.rjust(8)
        + f'{len(it["few_frames"]):13d}'
        + ('never' if back is None else f'{back} frames').rjust(16)
        + f'{hidden}+{in_view}'.rjust(12)
        + f'{len(it["redetections"]):8d}'
    )


def _time_rows(it: Mapping[str, Any]) -> list[str]:
    lines = [f'time per frame, {it["threads"]} OpenCV threads; ratio to bare calcOpticalFlowPyrLK']
    words = {
        'without': 'frames without anchoring',
        'with': 'frames with anchoring, every 5',
        'every': 'anchoring in every frame',
        'never': 'never anchored',
    }
    for key, word in words.items():
        of = it[key]
        lines.append(
            f'  {word:<32}{_px(of["tracker_ms"], 2):>8} ms, bare {_px(of["bare_ms"], 2):>6} ms, '
            f'ratio {_px(of["ratio"], 2)}, {_px(of["features"], 0)} features'
        )
    return lines


def _floor_rows(sizes: Sequence[Mapping[str, Any]]) -> list[str]:
    lines = [
        'processor time a frame, anchored, one thread; ratio to one pyramid and one bare flow'
    ]
    for it in sizes:
        width, height = it['size']
        quartiles = f'{_px(it["ratio_low"], 2)} to {_px(it["ratio_high"], 2)}'
        lines.append(
            f'  {f"{width}x{height}":<10}{_px(it["tracker_ms"], 2):>8} ms, '
            f'floor {_px(it["floor_ms"], 2)} ms, ratio {_px(it["ratio"], 2)} (quartiles '
            f'{quartiles}, worst frame {_px(it["ratio_worst"], 2)}, {_px(it["worst_ms"], 1)} ms)'
        )
    return lines


def _px(value: float | None, digits: int = 3) -> str:
    return '-' if value is None else f'{value:.{digits}f}'
