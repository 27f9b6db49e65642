"""Writes docs/parameters.md and docs/upgrading.md from the settings: python docs/parameters.py."""

from collections.abc import Sequence
from dataclasses import Field, fields
import inspect
from pathlib import Path
import re
import sys
from typing import Any

from visual_servo_epipolar.core.settings import parameters_of, range_of, Settings
from visual_servo_epipolar.nodes.startup.table import settings_of
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
HEADER = ('| parameter | default, range | what |', '|---|---|---|')
ALONE = 'Scenarios and replay alone:'
HEAD = """\
# Parameters

All parameters of all nodes, in the order of [`config/*.yaml`](../config), under the class that
declares them: each with its default, then its range or the other choices. `python
docs/parameters.py` writes this page; [upgrading](upgrading.md) has earlier names.

* Write a double with a point: `1.0`. A node refuses values out of range and unknown names. A file
  under `/**:` may hold the parameters of several nodes, as [`robot.yaml`](../config/robot.yaml).
* *fixed* parameters can be set at the start only; the others while the robot drives: `ros2 param
  set /servo_node max_linear 0.3`.
* *Step 1*, *Step 2*: of laws `paper`, `corrected` and `full`; law `smooth` ends by step 2 only
  without its memory.
* Scenario files take these names in sections `servo`, `tracker`, `base`, `camera` and
  `disturbances`, and those under *scenarios and replay alone*; `visual_servo replay --set
  servo.look_ahead=0.3` those of servo and tracker.
* Every node also takes `use_sim_time`. In names of files `~` stands for the home folder.
"""
UPGRADING = """\
# Upgrading from 0.1

`python docs/parameters.py` writes this page from the settings.

* **Parameters.** The tables name what was renamed or is gone. Names under *scenarios and replay
  alone* of [parameters](parameters.md) are settings that no robot needs: a parameter file
  may keep their defaults, and is refused in one line if it gives another value; scenario files,
  `replay --set` and Python keep them. A node that is given an old name says which one replaces
  it. Bags and scenarios with old names are read; a bag that was recorded with a setting that is
  gone replays with a note.
* **Start.** The servo waits for `~/start` unless `autostart` is set (false by default). Parameter
  files are keyed `/**:`.
* **Bags.** `recorder_node` writes mcap alone; bags of sqlite3 are read, and `ros2 bag convert`
  makes one of the other. `--repair` writes a new file beside the damaged one; `rosbags-convert`
  makes a bag of ROS 2 of one of ROS 1.
* **Values.** Set `estimator: soft_planar` in place of `planar_2dof` and `planar_3dof`, and
  `projection: equirectangular`, of the stitched image, in place of `dual_fisheye`.
* **Camera files** of COLMAP and nerfstudio are not read: write their numbers as YAML.
* **Commands.** `sweep` writes `table.md`, `map.png` and `runs.jsonl`; `bench` has only what
  [results](results.md) needs.
* **Python.** Import from [`visual_servo_epipolar.api`](../visual_servo_epipolar/api.py); all
  other modules are internal and have moved.
* **Folders of routes, photographs and bags** of 0.1 are read as before.

## What is gone

| gone since 0.1 | in its place |
|---|---|
| **Nodes**: `ackermann_cmd`, `cmd_vel_reversed` | `transform` of topic_tools, see [ros](ros.md) |
| `~/progress` and `~/result` of the servo, `~/frames` of the camera | `phase`, `/diagnostics`, `goal_pose`; `/tf` |
| `two_robots.launch.py`, `frame_prefix` | `simulation.launch.py` twice, with a `namespace` each |
| retries, timeouts and `wait_for_charge` of `dock_robot` | a behaviour tree; the timeouts of the servo |
| `on_error`, `servo`, `split_size`, `split_duration` of the recorder | its diagnostics; `ros2 bag convert` |
| a list of files as `desired_image` | a folder of photographs |
| images taken for rectified by the name of their topic | `rectified: true` |
| images of 16 bits, `nv21`, `nv24`; compressed ones but JPEG, PNG | a driver or image_proc that sends 8 bits |
| topics and services in `--help` of a node | `ros2 node info` |
| **Laws** named by expressions, as `full-retreat` | `retreat: false` in section `servo` of a scenario |
| **Routes**: `--steering epipole`, laps without a stop, extra `places` | `structure`; a lap ends at the station; not needed |
| worlds of `route demo` but `same` and `all`; `each` in its JSON | `--world all`; figures over all runs |
| `route replay`; `~/events`, `~/markers` of `route_node` | `~/progress` and `~/path` in its bags |
| **Bags** of ROS 1, or with topics not of ROS | `rosbags-convert`, `mcap filter` |
| recorded topics of types that are not of ROS itself | `ros2 bag record` |
| `--params` of `replay` and `report`; `history`, `effective_changes` | `--set`; `~/events`, `changes` |
| pages on routes, stills, tables of settings, the video in `report` | `route teach`, `video.mp4`, `ros2 bag info` |
| `--visible` of `demo` | `simulation.launch.py` |
| orientation tags of photographs, `inspect --yaw` | turn the picture; subtract the yaw |
| camera files without an image size | add the two keys |
| **Benchmarks**: `mounts_images`, simulated pairs, an echo | `sweep --source images`, `bench real` |
| `--seconds` of `bench latency` | 60 s a row, 4 s with `--quick` |
| sensitivities and variants of the experiment in `reproduce`, intervals of `sweep` | `sweep` with a scenario; `scipy.stats.bootstrap` |
| `faults --law`, `--table` | the default law; standard output |
| **Simulation**: `shadow` and knobs that no scenario set | the scenarios; an old knob is refused in one line |

## Names that changed
"""  # noqa: E501


def page() -> str:
    """Return the page of parameters; what an earlier node has likewise is named, not repeated."""
    shown: dict[str, str] = {}
    kinds = {name: [*settings_of(name)] for name in NODES} | {'Scenarios alone': [*SCENARIO]}
    return '\n'.join([HEAD, *(_chapter(name, each, shown) for name, each in kinds.items())])


def upgrading() -> str:
    """Return the page of names that changed, by node."""
    chapters = [UPGRADING]
    for node in NODES:
        rows: dict[str, str] = {}
        for kind in settings_of(node):
            rows |= {old: f'`{new}`' for old, new in kind.RENAMED.items()}
            off = {old: f'gone; {_written(value)} holds' for old, value in kind.GONE.items()}
            rows |= {old: text for old, text in off.items() if old not in rows}
        if rows:
            lines = [f'| `{old}` | {new} |' for old, new in sorted(rows.items())]
            chapters.append('\n'.join([f'### {node}\n', '| 0.1 | now |', '|---|---|', *lines, '']))
    return '\n'.join(chapters)


def _chapter(title: str, kinds: Sequence[type[Settings]], shown: dict[str, str]) -> str:
    rows: list[str] = []
    alone: list[str] = []
    same: dict[str, list[str]] = {}
    known = {item for kind in kinds for item in parameters_of(kind)}
    for owner, items in _owners(kinds).items():
        new = {item.name: _row(item) for item in items if item in known}
        internal = [item.name for item in items if item not in known]
        for name in [name for name, row in new.items() if row in shown]:
            same.setdefault(shown[new.pop(name)], []).append(f'`{name}`')
        rows += [_title(owner), *new.values()] if new else []
        alone += [name for name in internal if name not in shown]
        shown |= dict.fromkeys([*new, *new.values(), *internal], title)
    parts = [f'## {title}\n', *([*HEADER, *rows, ''] if rows else [])]
    parts += [f'As for {node}: {", ".join(names)}.\n' for node, names in same.items()]
    return '\n'.join(
        [*parts, *([f'{ALONE} {", ".join(f"`{name}`" for name in alone)}.\n'] if alone else [])]
    )


def _owners(kinds: Sequence[type[Settings]]) -> dict[type, list['Field[Any]']]:
    """Return the fields of all ``kinds`` by the class that declares them."""
    owners: dict[type, list[Field[Any]]] = {}
    for kind in kinds:
        for item in fields(kind):
            owners.setdefault(_owner(kind, item.name), []).append(item)
    return owners


def _owner(kind: type, name: str) -> type:
    """Return the class in which the field is written down: ``kind``, or one it inherits from."""
    return next(owner for owner in kind.__mro__ if name in vars(owner).get('__annotations__', ()))


def _title(owner: type) -> str:
    path = Path(inspect.getfile(owner)).resolve().relative_to(ROOT.resolve())
    return f'| [**{owner.__name__}**](../{path}) | | |'


def _row(item: 'Field[Any]') -> str:
    limits = range_of(item)
    cells = (
        f'`{item.name}`',
        _range(item.default, limits),
        limits.text.replace('|', r'\|'),
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


def _range(default: Any, limits: Any) -> str:
    """Return the default, then the range or the other choices."""
    parts = [f'`{value}`' for value in limits.choices if value != default]
    if not parts and limits.low is not None and limits.high is not None:
        parts = [f'{_short(limits.low)}..{_short(limits.high)}']
    return ', '.join([f'`{_written(default)}`', *parts, *(['fixed'] if limits.read_only else [])])


def _short(value: float) -> str:
    return str(value) if isinstance(value, int) else f'{value:g}'


def main(folder: Path) -> None:
    """Write both pages."""
    (folder / 'parameters.md').write_text(page(), encoding='utf-8')
    (folder / 'upgrading.md').write_text(upgrading(), encoding='utf-8')


if __name__ == '__main__':
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
