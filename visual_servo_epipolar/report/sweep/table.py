"""Table of a sweep, one column a law."""

from collections.abc import Callable, Mapping
import math
from typing import Any

Document = Mapping[str, Any]
Documents = Mapping[str, Document]  # law -> what `visual_servo sweep` writes as JSON for it

NOTE = (
    'Errors over the runs that arrived, against ground truth, without their signs; the interval '
    "is Wilson's. Wrong: more than 50 mm or 2 deg off; wrong geometry: time driven on bearings "
    'more than 10 deg off.'
)


def table(documents: Documents) -> str:
    """Return a Markdown table of the sweep, one column a law, and one of why runs failed."""
    rows = [[name, *map(cell, documents.values())] for name, cell in _rows().items()]
    blocks = [
        f'`{next(iter(documents.values()))["sweep"]["command"]}`',
        '',
        *_markdown(['', *documents], rows),
    ]
    failures = _failures(documents)
    if failures:
        blocks += ['', *_markdown(['why runs failed', *documents], failures)]
    return '\n'.join([*blocks, '', NOTE])


def _rows() -> Mapping[str, Callable[[Document], str]]:
    return {
        'arrived': _arrivals,
        'arrived, 95 % interval [%]': lambda d: _percent(d['success_interval']),
        'arrived but wrong': lambda d: str(d['arrived_but_wrong']),
        'raised': lambda d: str(d['defects']),
        'position error, median / p95 / max [mm]': lambda d: _spread(d, 'position_error_m', 1e3),
        'lateral [mm]': lambda d: _spread(d, 'lateral_error_m', 1e3),
        'longitudinal [mm]': lambda d: _spread(d, 'longitudinal_error_m', 1e3),
        'heading error [deg]': lambda d: _spread(d, 'heading_error_deg', 1.0),
        'largest distance / start distance': lambda d: _spread(d, 'max_distance_ratio', 1.0),
        'the same, all runs': lambda d: _spread(d, 'excursion', 1.0),
        'wrong geometry, all runs [s]': lambda d: _spread(d, 'wrong_geometry_s', 1.0),
        'duration [s]': lambda d: _spread(d, 'duration_s', 1.0),
        'duration / least time T_0': lambda d: _spread(d, 'time_ratio', 1.0),
        'standstills on the way': lambda d: _spread(d, 'standstills', 1.0),
        'within 20 mm without an end, all runs [s]': lambda d: _spread(d, 'standing_s', 1.0),
        'reversals of v, all runs': lambda d: _spread(d, 'reversals_v', 1.0),
        'reversals of w, all runs': lambda d: _spread(d, 'reversals_w', 1.0),
        'changes of phase': lambda d: _spread(d, 'phase_changes', 1.0),
        'peak jerk [m/s^3]': lambda d: _spread(d, 'peak_jerk_m_s3', 1.0),
        'peak jerk [rad/s^3]': lambda d: _spread(d, 'peak_jerk_rad_s3', 1.0),
        'path [m]': lambda d: _spread(d, 'path_length_m', 1.0),
        'attempts': lambda d: _spread(d, 'attempts', 1.0),
        'wall time of the sweep [s]': lambda d: _number(d['wall_s'], 1.0),
    }


def _failures(documents: Documents) -> list[list[str]]:
    """Return reason and counts, those of the last law first."""
    counts = [document['failure_reasons'] for document in documents.values()]
    reasons = sorted(
        {reason for of in counts for reason in of},
        key=lambda reason: [-of.get(reason, 0) for of in counts[::-1]],
    )
    return [[_cell(reason), *(str(of.get(reason, 0)) for of in counts)] for reason in reasons]


def _arrivals(document: Document) -> str:
    runs = len(document['runs'])
    return f'{100.0 * document["success_rate"]:.4g} % ({document["arrived"]} of {runs})'


def _spread(document: Document, name: str, unit: float) -> str:
    spread = document.get(name, {})  # that of an earlier version may lack it
    return ' / '.join(_number(spread.get(key), unit) for key in ('median', 'p95', 'max'))


def _percent(interval: tuple[float, float]) -> str:
    return ' to '.join(f'{100.0 * value:.2f}' for value in interval)


def _number(value: float | None, unit: float) -> str:
    """Say a number in three digits; a dash for one that there is not."""
    if value is None or not math.isfinite(value):
        return '-'
    return f'{unit * value:.0f}' if abs(unit * value) >= 100.0 else f'{unit * value:#.3g}'


def _cell(text: str) -> str:
    return ' '.join(text.split()).replace('|', '\\|')


def _markdown(head: list[str], rows: list[list[str]]) -> list[str]:
    """Return the lines of a table, columns padded so that it can be read as text too."""
    widths = [max(len(line[k]) for line in (head, *rows)) for k in range(len(head))]

    def line(cells: list[str]) -> str:
        padded = [cell.ljust(width) for cell, width in zip(cells, widths, strict=True)]
        return f'| {" | ".join(padded)} |'

    return [line(head), f'|{"|".join("-" * (width + 2) for width in widths)}|', *map(line, rows)]
