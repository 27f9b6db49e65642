"""Writes docs/parameters.md, the reference of all parameters: python docs/parameters.py."""

from collections.abc import Iterator, Sequence
from dataclasses import Field, fields
from importlib import import_module
import inspect
from pathlib import Path
import re
import sys
from types import ModuleType
from typing import Any

from visual_servo_epipolar.core.settings import range_of, Settings
from visual_servo_epipolar.simulation.point_world import PointSettings
from visual_servo_epipolar.simulation.scenario import RunSettings

ROOT = Path(__file__).parents[1]
NODES = (
    'servo_node',
    'tracker_node',
    'camera_node',
    'unicycle_node',
    'recorder_node',
    'dock_node',
    'route_node',
)
SCENARIO = (RunSettings, PointSettings)  # sections run and points
DECLARATION = re.compile(r'parameters\.declare\(self, (\w+)\)')
HEADER = ('| parameter | default | range | what | |', '|---|---|---|---|---|')
ALONE = 'Scenario files and replay alone:'
HEAD = """\
# Parameters

This page lists all parameters of all nodes, in the order of [`config/*.yaml`](../config), under
the class that declares them. `python docs/parameters.py` writes it from those classes; a test
compares the two.

* Write a double with a point: `1.0`, not `1`. A node refuses values out of range, and names that
  it does not have. A file under `/**:` may hold the parameters of several nodes, as
  [`robot.yaml`](../config/robot.yaml) does.
* *fixed* marks parameters that can be set at the start only. The others can be changed while the
  robot drives: `ros2 param set /servo_node max_linear 0.3`.
* *Step 1*, *Step 2*: of laws `paper`, `corrected` and `full`. Law `smooth` has one motion instead,
  and ends by step 2 only where it has no memory of views. What names neither serves all laws.
* Scenario files accept these names in sections `servo`, `tracker`, `base`, `camera` and
  `disturbances`, the names under *scenario files and replay alone*, and those at the end of this
  page. `visual_servo replay --set servo.look_ahead=0.3` accepts those of servo and tracker.
* Every node also takes `use_sim_time`, as all ROS nodes do.
* `~` stands for the home folder in names of files and folders.
"""


def page() -> str:
    """Return the whole page."""
    nodes = [_chapter(name, settings_of(_module(name))) for name in NODES]
    return '\n'.join([HEAD, *nodes, _chapter('Scenarios alone', SCENARIO)])


def settings_of(module: ModuleType) -> list[type[Settings]]:
    """Return the classes whose fields a node declares as parameters, in its order."""
    return [getattr(module, name) for name in DECLARATION.findall(inspect.getsource(module))]


def _module(node: str) -> ModuleType:
    return import_module(f'visual_servo_epipolar.nodes.{node}')


def _chapter(title: str, kinds: Sequence[type[Settings]]) -> str:
    return '\n'.join([f'## {title}\n', *(part for kind in kinds for part in _sections(kind))])


def _sections(kind: type[Settings]) -> Iterator[str]:
    """Yield a section for each class that declares fields of ``kind``."""
    owners: dict[type, list[Field[Any]]] = {}
    for item in fields(kind):
        owners.setdefault(_owner(kind, item.name), []).append(item)
    for owner, items in owners.items():
        rows = [_row(item) for item in items if not range_of(item).internal]
        others = ', '.join(f'`{item.name}`' for item in items if range_of(item).internal)
        table = [*HEADER, *rows, ''] if rows else []
        yield '\n'.join([_title(owner), *table, *([f'{ALONE} {others}.\n'] if others else [])])


def _owner(kind: type, name: str) -> type:
    """Return the class in which the field is written down: ``kind``, or one it inherits from."""
    return next(owner for owner in kind.__mro__ if name in vars(owner).get('__annotations__', ()))


def _title(owner: type) -> str:
    path = Path(inspect.getfile(owner)).resolve().relative_to(ROOT.resolve())
    summary = (inspect.getdoc(owner) or '').split('\n\n')[0].replace('\n', ' ')
    return f'### [`{owner.__name__}`](../{path})\n\n{summary}\n'


def _row(item: 'Field[Any]') -> str:
    limits = range_of(item)
    cells = (
        f'`{item.name}`',
        f'`{_written(item.default)}`',
        _range(limits.low, limits.high, limits.choices),
        limits.text.replace('|', r'\|'),
        'fixed' if limits.read_only else '',
    )
    return f'| {" | ".join(cells)} |'


def _written(value: Any) -> str:
    """Return a default as YAML has it."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f'[{", ".join(map(_written, value))}]'
    if isinstance(value, str):
        return value if re.fullmatch(r'\w+', value) else f"'{value}'"
    return f'{value:.6g}' if isinstance(value, float) and value != int(value) else repr(value)


def _range(low: float | None, high: float | None, choices: tuple[str, ...]) -> str:
    if choices:
        return ', '.join(f'`{choice}`' for choice in choices)
    return '' if low is None or high is None else f'{_short(low)} to {_short(high)}'


def _short(value: float) -> str:
    return str(value) if isinstance(value, int) else f'{value:g}'


def main(target: Path) -> None:
    """Write the page."""
    target.write_text(page(), encoding='utf-8')


if __name__ == '__main__':
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name('parameters.md'))
