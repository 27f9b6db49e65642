"""Text of a replay for the terminal, from its JSON document."""

from collections.abc import Mapping
from typing import Any

COMPARED = (
    'phase',
    'linear_m_s',
    'angular_rad_s',
    'epipole_current_px',
    'epipole_desired_px',
    'bearing_current_rad',
    'bearing_desired_rad',
    'feature_difference_px2',
)
MAX_NAMED = 6  # quantities that differ in the first step, at most this many are named


def in_words(result: Mapping[str, Any]) -> str:
    """Return the result of a replay and its comparison as text."""
    duration_s, wall_s = result['duration_s'], result['wall_s']
    lines = [
        f'{result["steps"]} steps from {result["source"]}, {duration_s:.1f} s replayed in '
        f'{wall_s:.1f} s ({duration_s / wall_s:.1f} x real time)'
    ]
    lines += [
        f'  {section}.{name} = {value}'
        for section, values in result['changes'].items()
        for name, value in values.items()
    ]
    lines += [f'  note: {note}' for note in result['notes']]
    lines += [
        f'  {phase["start_s"]:6.1f} - {phase["end_s"]:6.1f} s  {phase["name"]}'
        for phase in result['phases']
    ]
    return '\n'.join([*lines, *compared_words(result['comparison'])])


def compared_words(comparison: Mapping[str, Any]) -> list[str]:
    """Return the comparison of recorded and replayed, line by line."""
    if not comparison['compared_steps']:
        return ['nothing was recorded to compare with']
    lines = [*_missing(comparison), _verdict(comparison)]
    divergence = comparison['parting']
    if divergence is not None:
        lines += _first(divergence['quantities'])
    differences = comparison['differences']
    rows = [(name, differences[name]) for name in COMPARED if name in differences]
    differing = [(name, row) for name, row in rows if row['largest'] or row['apart']]
    if differing:
        lines.append(f'{"quantity":<24}{"steps apart":>12}{"largest":>12}{"rms":>12}')
        lines += [_row(name, row) for name, row in differing]
    return lines


def _verdict(comparison: Mapping[str, Any]) -> str:
    steps, tolerance = comparison['compared_steps'], comparison['tolerance']
    divergence = comparison['parting']
    if divergence is not None:
        return (
            f'recorded and replayed diverge at {divergence["time_s"]:.3f} s, '
            f'stamp {divergence["stamp_ns"]} ns:'
        )
    if tolerance == 0.0:
        how = 'the same to the last bit'
    else:
        how = f'the same within {tolerance:g}' if tolerance < float('inf') else 'beside each other'
    return f'recorded and replayed: {steps} steps, {how}'


def _missing(comparison: Mapping[str, Any]) -> list[str]:
    lines = []
    if comparison['missing_steps']:
        lines.append(f'{comparison["missing_steps"]} recorded steps have no image in the bag')
    if comparison['unheard_commands']:
        lines.append(f'{comparison["unheard_commands"]} replayed commands were not published then')
    return lines


def _first(quantities: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Name the quantities of the first difference, the most important first."""
    names = [name for name in COMPARED if name in quantities]
    names += [name for name in quantities if name not in names]
    lines = [
        f'  {name}: recorded {_plain(quantities[name]["recorded"])}, '
        f'replayed {_plain(quantities[name]["replayed"])}'
        for name in names[:MAX_NAMED]
    ]
    more = len(names) - MAX_NAMED
    return lines + ([f'  and {more} quantities more'] if more > 0 else [])


def _row(name: str, row: Mapping[str, Any]) -> str:
    if name == 'phase':
        return f'{name:<24}{row["apart"]:>12}'
    return f'{name:<24}{row["apart"]:>12}{row["largest"]:>12.3g}{row["rms"]:>12.3g}'


def _plain(value: float | str) -> str:
    return value if isinstance(value, str) else repr(float(value))
