"""Text of a replay for the terminal, from its JSON document."""

from collections.abc import Mapping
from typing import Any

from visual_servo_epipolar.bags.replaying.plan import differing_versions

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
    duration_s, wall_s = result['recorded_s'], result['wall_s']
    lines = [
        f'{result["steps"]} steps from {result["source"]}, {duration_s:.1f} s replayed in '
        f'{wall_s:.1f} s ({duration_s / wall_s:.1f} x real time)'
    ]
    lines += [
        f'  {section}.{name} = {value}'
        for section, values in result['effective_changes'].items()
        for name, value in values.items()
    ]
    if result['changes'] and not result['effective_changes']:
        lines.append('  all settings given are those that were recorded')
    lines += [f'  note: {note}' for note in result['notes']]
    lines += [
        f'  {phase["start_s"]:6.1f} - {phase["end_s"]:6.1f} s  {phase["name"]}'
        for phase in result['phases']
    ]
    end_s = result['phases'][-1]['end_s']
    if duration_s > end_s:
        lines.append(f'  {result["outcome"]}; the recording goes on to {duration_s:.1f} s')
    return '\n'.join([*lines, *compared_words(result['comparison'], result['versions'])])


def compared_words(
    comparison: Mapping[str, Any], versions: Mapping[str, Mapping[str, str]]
) -> list[str]:
    """Return the comparison of recorded and replayed, line by line."""
    if not comparison['compared_steps']:
        return ['nothing was recorded to compare with']
    if comparison['rounding'] is not None:
        return [*_rounding(comparison, versions), *_rows(comparison)]
    lines = [*_missing(comparison), _verdict(comparison)]
    divergence = comparison['parting']
    if divergence is not None:
        lines += _first(divergence['quantities'])
    return lines + _rows(comparison)


def _rounding(
    comparison: Mapping[str, Any], versions: Mapping[str, Mapping[str, str]]
) -> list[str]:
    recorded, replayed = differing_versions(versions['recorded'])
    if recorded:
        cause = f'recorded with {recorded}, replayed with {replayed}'
    elif versions['recorded'].keys() < versions['replayed'].keys():
        cause = 'the bag does not say which numpy and OpenCV recorded it'
    else:
        cause = 'numpy and OpenCV are the same, so another processor or build of them rounds'
    return [
        f'recorded and replayed: {comparison["compared_steps"]} steps, rounding only, from '
        f'{comparison["parting"]["time_s"]:.3f} s',
        f'  {cause}: --tolerance {comparison["rounding"]:g} takes them as equal',
    ]


def _rows(comparison: Mapping[str, Any]) -> list[str]:
    lines: list[str] = []
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
