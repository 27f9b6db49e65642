"""The document of the estimation benchmark as text."""

from collections.abc import Iterable, Mapping
from typing import Any


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: accuracy, bound, honesty, signs, degeneracy, time."""
    versions = ', '.join(f'{name} {v}' for name, v in document['versions'].items() if v)
    lines = [
        f'Estimation: {document["trials"]} trials a cell, 26 points, 0.3 px in both images, '
        f'f = 770 px; {versions}; OpenCV on one thread',
    ]
    if document['versions']['poselib'] is None:
        lines.append('poselib is not installed: its rows are left out (pip install poselib)')
    kinds = dict.fromkeys(it['kind'] for it in document['accuracy'])
    for kind in kinds:
        lines += ['', f'Epipole error, {kind} [deg]: median/p95, and failures above 5 deg [%]']
        lines += _accuracy([it for it in document['accuracy'] if it['kind'] == kind])
    lines += ['', 'Error of planar_2dof in units of the Cramer-Rao bound (ideal scenes)']
    lines += [_bound_row(it) for it in document['bound']]
    lines += ['', 'Error in units of the deviation that is reported, at a parallax above 25 sigma']
    lines += [_consistency_row(it) for it in document['honesty']]
    lines += ['', 'A second geometry reported, and gross errors without one [% of trials]']
    lines += [_alternative_row(it) for it in document['rivals']]
    lines += ['', 'Baseline reversed (0.5 px, 30 % outliers, all around the goal) [%]']
    lines += [_sign_row(it) for it in document['signs']]
    lines += ['', 'Pure rotation against a baseline of 2 cm, by the parallax of fit_rotation']
    lines += [_degeneracy_row(it) for it in document['degeneracy']]
    for it in document['time']:
        lines += ['', f'Time, {it["points"]} points, {it["cell"]}; ratio to OpenCV LMedS by pairs']
        lines += [_time_row(method, row) for method, row in it['rows'].items()]
    return '\n'.join(lines)


def _accuracy(cells: Iterable[Mapping[str, Any]]) -> list[str]:
    cells = list(cells)
    lines = [' ' * 20 + ''.join(f'{it["cell"]:>20}' for it in cells)]
    for method in cells[0]['rows']:
        lines.append(f'  {method:<18}' + ''.join(_cell(it['rows'][method]) for it in cells))
    return lines


def _cell(row: Mapping[str, float]) -> str:
    gross = f'({100 * row["gross"]:.1f})' if row['gross'] else ''
    return f'{_degrees(row["median_deg"])}/{_degrees(row["p95_deg"])}{gross:>7}'.rjust(20)


def _degrees(value: float) -> str:
    return f'{value:.3f}' if value < 1.0 else f'{value:.2f}' if value < 10.0 else f'{value:.0f}'


def _bound_row(it: Mapping[str, Any]) -> str:
    return (
        f'  {it["baseline_m"]:g} m: bound {it["bound_deg"]:.3f} deg, rms {it["rms"]:.3f}, '
        f'less the largest 1 % {it["trimmed_rms"]:.3f}'
    )


def _consistency_row(it: Mapping[str, Any]) -> str:
    return (
        f'  {it["case"]:<28}{it["baseline_m"]:>5g} m: rms {it["rms"]:.2f}, less the largest 1 % '
        f'{it["trimmed_rms"]:.2f}, of {it["count"]}'
    )


def _alternative_row(it: Mapping[str, Any]) -> str:
    rows = '   '.join(
        f'{method} {100 * row["reported"]:.1f} and {100 * row["gross_unreported"]:.1f}'
        for method, row in it['rows'].items()
    )
    return f'  {it["cell"]:<20}{rows}'


def _sign_row(it: Mapping[str, Any]) -> str:
    flips = '   '.join(f'{method} {100 * share:.1f}' for method, share in it['flips'].items())
    return f'  {it["baseline_m"]:g} m, {it["trials"]} trials:  {flips}'


def _degeneracy_row(it: Mapping[str, Any]) -> str:
    return (
        f'  jitter {it["jitter_deg"]:g} deg: AUC {it["auc"]:.4f}; parallax {it["still_px"]:.2f} '
        f'px at rest, {it["moved_px"]:.2f} px moved'
    )


def _time_row(method: str, row: Mapping[str, float]) -> str:
    return (
        f'  {method:<20}{row["median_ms"]:7.2f} ms  (quartiles {row["quarter_ms"]:.2f} to '
        f'{row["three_quarters_ms"]:.2f})  {row["times_faster"]:6.1f} times faster'
    )
