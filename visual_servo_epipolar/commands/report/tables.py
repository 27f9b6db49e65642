"""Tables of a report: result, phases, parameters, versions."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

from visual_servo_epipolar.core.laws.registry import phase_words
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import range_of, Settings
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.report.page import Cell, folded_html, Section, table
from visual_servo_epipolar.simulation.scenario import Scenario

QUANTITIES = (  # key, words, unit, factor to that unit
    ('position_error_m', 'distance from the goal', 'mm', 1e3),
    ('lateral_error_m', 'lateral error', 'mm', 1e3),
    ('longitudinal_error_m', 'longitudinal error', 'mm', 1e3),
    ('heading_error_deg', 'heading error', 'deg', 1.0),
    ('duration_s', 'duration', 's', 1.0),
    ('recorded_s', 'duration of the recording', 's', 1.0),
    ('path_length_m', 'length of the path', 'm', 1.0),
    ('max_distance_ratio', 'largest distance, of that at the start', '', 1.0),
    ('max_linear_speed', 'largest linear speed', 'm/s', 1.0),
    ('max_angular_speed', 'largest angular speed', 'rad/s', 1.0),
    ('min_visible_features', 'fewest features in view', '', 1),
    ('attempts', 'attempts', '', 1),
    ('seed', 'seed', '', 1),
)
KINDS: Mapping[str, type[Settings]] = {
    **{item.name: item.default_factory for item in fields(Scenario)},  # type: ignore[misc]
    'servo': ServoSettings,
    'tracker': TrackerSettings,
}


def result_table(result: Mapping[str, Any]) -> str:
    """Return the figures of a run with their units."""
    rows: list[Sequence[Cell]] = []
    for key, words, unit, factor in QUANTITIES:
        if key in result:
            value = result[key]
            known = f'{value * factor:.4g}' if isinstance(value, float) else _as_text(value)
            rows.append([words, known, unit])
    return table(['quantity', 'value', 'unit'], rows)


def phase_table(result: Mapping[str, Any]) -> str:
    """Return the phases of a run one after the other."""
    return table(
        ['from [s]', 'to [s]', 'phase', 'what it does'],
        [
            [
                f'{item["start_s"]:.2f}',
                f'{item["end_s"]:.2f}',
                item['name'],
                phase_words(item['name']),
            ]
            for item in result['phases']
        ],
    )


def parameter_section(settings: Mapping[str, Mapping[str, Any]]) -> Section:
    """Return the settings part by part; those that are not the default stand out."""
    parts = [_parameters(part, values) for part, values in settings.items()]
    return Section('Parameters', '\n'.join(parts) or '<p>none were recorded</p>')


def _parameters(part: str, values: Mapping[str, Any]) -> str:
    known = {item.name: item for item in fields(KINDS[part])} if part in KINDS else {}
    rows, changed = [], []
    for name, value in values.items():
        default, meaning = None, ''
        if name in known:
            default, meaning = known[name].default, range_of(known[name]).text
        rows.append([name, _as_text(value), _as_text(default), meaning])
        changed.append(default is not None and _as_text(value) != _as_text(default))
    title = f'{part}: {sum(changed)} of {len(values)} other than the default'
    head = ['name', 'value', 'default', 'meaning [unit]']
    return folded_html(title, table(head, rows, changed=changed))


def _as_text(value: Any) -> str:
    if value is None:
        return '\N{EN DASH}'
    if isinstance(value, (list, tuple)):
        return '[' + ', '.join(_as_text(item) for item in value) + ']'
    return str(value)


def version_section(ran_with: Mapping[str, str], made_with: Mapping[str, str]) -> Section:
    """Return the versions that the run had, and those of this report."""
    rows: list[Sequence[Cell]] = [
        [name, ran_with.get(name, '\N{EN DASH}'), made_with.get(name, '\N{EN DASH}')]
        for name in dict.fromkeys([*ran_with, *made_with])
    ]
    return Section('Versions', table(['of', 'when it ran', 'of this report'], rows))
