"""
The whole demo in lockstep against real time: the command as it is called, from start to end.

And while it drives: what a long drive has more than a short one, of simulated and of wall time, so
that imports, the room and the figures do not count. Modules are compiled before, as they are after
a first start.
"""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
import json
import os
from pathlib import Path
import subprocess
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np

from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.evaluation.live.processes import start_module
from visual_servo_epipolar.evaluation.tables import aligned

PACKAGE = 'visual_servo_epipolar'
VARIANTS: Mapping[str, tuple[str, ...]] = {
    'video and bag': (),
    'bag': ('--no-video',),
    'neither': ('--no-video', '--bag', 'none'),
}
TRIALS = 3
COLUMNS = (
    'with | simulated s | wall s | least | most | processor s | times real time | while it drives'
)
SHORT, LONG, QUICK_LONG = ('0', '-0.3', '0'), ('1', '-3.5', '8'), ('0.1', '-1', '2')  # starts


Times = tuple[float, float, float]  # simulated, wall and processor [s]


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Return, for each variant, simulated seconds over those that the command took."""
    rows = []
    with TemporaryDirectory(prefix='visual_servo_') as compiled:
        say('demo, for modules that are compiled when they are first imported ...')
        first = next(iter(VARIANTS.values()))
        _time_demo(('--seed', str(seed), '--start', *SHORT, *first), Path(compiled))
        for name, arguments in VARIANTS.items():
            drives: tuple[list[Times], list[Times]] = [], []
            for trial in range(1 if quick else TRIALS):
                say(f'demo with {name}, {trial + 1} ...')
                for kept, start in zip(
                    drives, (SHORT, QUICK_LONG if quick else LONG), strict=True
                ):
                    given = '--seed', str(seed), '--start', *start, *arguments
                    kept.append(_time_demo(given, Path(compiled)))
            rows.append(_row(name, *drives))
    return {'seed': seed, 'rows': rows}


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text."""
    rows = (
        [
            it['with'],
            *(f'{each:.1f}' for each in (it['simulated_s'], it['wall_s'], *it['spread_s'])),
            f'{it["processor_s"]:.1f}',
            *(f'{it[name]:.2f}' for name in ('real_time', 'driving_real_time')),
        ]
        for it in document['rows']
    )
    words = 'visual_servo demo in lockstep, 1280x1024 at 11 Hz, start of the interpreter included'
    return '\n'.join([words, *aligned(COLUMNS, rows)])


def figures(document: Mapping[str, Any]) -> dict[str, float]:
    """Return what to compare between runs; less is better."""
    return {
        f'demo with {it["with"]}, wall over simulated time': 1.0 / it['real_time']
        for it in document['rows']
    }


def _time_demo(arguments: tuple[str, ...], compiled: Path) -> Times:
    """
    Run the demo, and return simulated, wall and processor time [s].

    Modules that it compiles are kept in ``compiled``, whatever the environment says.
    """
    environment = {**os.environ, 'PYTHONPYCACHEPREFIX': str(compiled)}
    environment.pop('PYTHONDONTWRITEBYTECODE', None)
    with TemporaryDirectory(prefix='visual_servo_') as folder, ExitStack() as stack:
        result = Path(folder, 'timed.json')
        given = *arguments, '--out', str(Path(folder, 'out')), '--json', str(result)
        streams = {'stdout': subprocess.DEVNULL, 'stderr': subprocess.PIPE}
        before, began = os.times(), perf_counter()
        process = start_module(stack, PACKAGE, 'demo', *given, env=environment, **streams)
        _, errors = process.communicate()
        wall, after = perf_counter() - began, os.times()
        if not result.exists():
            raise VisualServoError(f'the demo gave no result: {errors.decode().strip()}')
        simulated = float(json.loads(result.read_text())['duration_s'])
    spent = after.children_user + after.children_system
    return simulated, wall, spent - before.children_user - before.children_system


def _row(name: str, short: list[Times], long: list[Times]) -> dict[str, Any]:
    simulated, wall, processor = np.median(long, axis=0)
    more_simulated, more_wall, _ = np.median(long, axis=0) - np.median(short, axis=0)
    walls = [trial[1] for trial in long]
    return {
        'with': name,
        'simulated_s': float(simulated),
        'wall_s': float(wall),
        'spread_s': [min(walls), max(walls)],
        'processor_s': float(processor),
        'real_time': float(simulated / wall),
        'driving_real_time': float(more_simulated / more_wall),
    }
