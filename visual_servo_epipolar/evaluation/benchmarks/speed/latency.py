"""
Latency benchmark: from an image on the wire to the twist on the wire.

The floor beside it, in the same run by turns: an echo node that answers each image of the same
size by an empty twist, and what tracker and servo take for the same images in memory: one upon the
other, and at the rate at which they come. The camera is this process; images are those of a run
that the servo has driven before: it commands now as it did, and is as sure of where it is.
"""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.evaluation.benchmarks.speed.driven_run import (
    are_same,
    driven,
    DrivenRun,
    in_memory,
)
from visual_servo_epipolar.evaluation.live.chain import (
    Answers,
    ECHO,
    PlayedCamera,
    TRACKER_AND_SERVO,
)
from visual_servo_epipolar.evaluation.live.processes import costs, spent, Stretch
from visual_servo_epipolar.evaluation.tables import aligned
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

OPTIONS = ('seconds',)  # of the command line that this benchmark takes
FULL = CameraSettings(frame_rate=30.0)
CELLS = (
    replace(
        FULL,
        width=640,
        height=480,
        focal_length=FULL.focal_length / 2.0,
        principal_u=319.5,
        principal_v=239.5,
        frame_rate=60.0,
    ),
    FULL,
)
SECONDS, QUICK_SECONDS = 60.0, 4.0
TURN_S = 20.0  # at most, nodes and echo by turns: load from elsewhere hits both
LEAD_RATE = 10.0  # of images before a run [Hz]
ECHO_SHARE = 0.25  # of the time of the nodes
LATENCIES = (
    'size and rate | p50 | p99 | p99.9 | images | drops | as driven | echo p50 '
    '| echo p99 | tracker | servo | floor | ratio | tracker, servo, floor at the rate | its ratio'
)
COSTS = 'size and rate | process | processor ms a frame | memory MB | peak'
QUANTILES = {'p50': 0.5, 'p99': 0.99, 'p99.9': 0.999}


class TwoNodes:
    """Tracker and servo; their camera is this process."""

    def __init__(self, loop: PlayedCamera, run: DrivenRun) -> None:
        self._loop, self._run = loop, run
        self.processes = {name: loop.processes[name] for name in TRACKER_AND_SERVO}
        self.as_driven = 0

    def wait_for_answers(self) -> None:
        """Show the photograph, and images until they are answered."""
        self._loop.show_goal(self._run.photograph)

    def begin(self) -> None:
        """Show the start while the servo is stopped, and start it anew."""
        self._loop.call('servo_node/stop')
        self._loop.call('tracker_node/redetect')
        first, *lead = self._run.lead
        self._loop.show_each([first], LEAD_RATE)  # to find the photograph takes a while
        self._loop.show_each(lead, LEAD_RATE)
        for service in ('reset', 'start'):
            self._loop.call(f'servo_node/{service}')

    def turn(self, seconds: float) -> Answers:
        """Show the run from its start on, and to its end at most."""
        run = self._run
        drive = self._loop.show_each(run.images[: round(seconds * run.rate)], run.rate)
        answers = zip(drive.numbers, drive.twists, strict=True)
        self.as_driven += sum(are_same(twist, run.twists[number]) for number, twist in answers)
        return drive


def run(
    *, seed: int, quick: bool, say: Callable[[str], None], seconds: float | None = None
) -> dict[str, Any]:
    """Return the document: for each size of image latency, floor, drops and costs."""
    seconds = seconds or (QUICK_SECONDS if quick else SECONDS)
    rows = [
        _measure_size(replace(cell, seed=seed), seconds, say)
        for cell in (CELLS[:1] if quick else CELLS)
    ]
    return {'seconds': seconds, 'rows': rows}


def _measure_size(
    settings: CameraSettings, seconds: float, say: Callable[[str], None]
) -> dict[str, Any]:
    """Return the row of one size: latencies, floor, drops, and what each process costs."""
    size, rate = [settings.width, settings.height], settings.frame_rate
    title, run_s = f'{size[0]}x{size[1]} at {rate:g} Hz', seconds / _turns(seconds)
    with TemporaryDirectory(prefix='visual_servo_') as scratch, ExitStack() as stack:
        say(f'{title}: driving for {run_s:g} s ...')
        run = driven(settings, run_s, Path(scratch))
        say(f'{title}: tracker and servo in memory ...')
        floor, paced = in_memory(run), in_memory(run, paced=True)
        say(f'{title}: starting nodes ...')
        loop = PlayedCamera(
            stack, run.camera, run.images, Path(scratch), {**ECHO, **TRACKER_AND_SERVO}
        )
        chain = TwoNodes(loop, run)
        chain.wait_for_answers()
        loop.wait_for_listeners(1, to_echo=True)
        row = _by_turns(chain, loop, rate, seconds, lambda text: say(f'{title}: {text}'))
    echo = row['echo']['p50']
    floors = {'floor': _floor(echo, floor), 'paced_floor': _floor(echo, paced)}
    return {'size': size, 'rate': rate, **floors, **row}


def _floor(echo_ms: float, in_memory_ms: dict[str, float]) -> dict[str, float]:
    parts = {'echo_ms': echo_ms, **in_memory_ms}
    return {**parts, 'sum_ms': sum(parts.values())}


def _turns(seconds: float) -> int:
    return max(1, math.ceil(seconds / TURN_S))


def _by_turns(
    chain: TwoNodes,
    loop: PlayedCamera,
    rate: float,
    seconds: float,
    say: Callable[[str], None],
) -> dict[str, Any]:
    """Drive nodes and echo by turns, and return what both took."""
    turns = _turns(seconds)
    nodes, echoes = Answers(), Answers()
    stretches: list[Stretch] = []
    for turn in range(turns):
        say(f'turn {turn + 1} of {turns}, {seconds / turns:g} s and its echo ...')
        chain.begin()
        before = costs(chain.processes)
        nodes += chain.turn(seconds / turns)
        stretches.append((before, costs(chain.processes)))
        echoes += loop.show(ECHO_SHARE * seconds / turns, rate, to_echo=True)
    return {
        'nodes': {**_answers(nodes), 'as_driven': chain.as_driven / len(nodes.twists)},
        'echo': _answers(echoes),
        'processes': spent(stretches, len(nodes.sent)),
    }


def _answers(drive: Answers) -> dict[str, Any]:
    """Return quantiles [ms] of the latencies, and how many images have no answer."""
    if not drive.latencies:
        raise VisualServoError(
            'no image was answered; start the nodes by hand and read their logs'
        )
    values = 1e3 * np.quantile(drive.latencies, list(QUANTILES.values()))
    return {
        'images': len(drive.sent),
        'drops': len(drive.sent) - len(drive.latencies),
        'moving': drive.moving / len(drive.latencies),
        **{name: float(value) for name, value in zip(QUANTILES, values, strict=True)},
    }


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: latencies and floor, then what each process costs."""
    rows = document['rows']
    costs_of = [(_title(row), name, it) for row in rows for name, it in row['processes'].items()]
    return '\n'.join(
        [
            'Latency, image on the wire to twist on the wire; tracker and servo, '
            f'{document["seconds"]:g} s a row, [ms]',
            '',
            *aligned(LATENCIES, map(_latencies, rows)),
            '',
            *aligned(COSTS, (_cost(*each) for each in costs_of), left=2),
        ]
    )


def _latencies(row: Mapping[str, Any]) -> list[str]:
    nodes, echo, floor, paced = (row[it] for it in ('nodes', 'echo', 'floor', 'paced_floor'))
    return [
        _title(row),
        *(f'{nodes[name]:.1f}' for name in QUANTILES),
        *(str(nodes[name]) for name in ('images', 'drops')),
        f'{nodes["as_driven"]:.1%}',
        *(f'{echo[name]:.1f}' for name in ('p50', 'p99')),
        *(f'{floor[f"{name}_ms"]:.1f}' for name in ('tracker', 'servo', 'sum')),
        f'{nodes["p50"] / floor["sum_ms"]:.2f}',
        f'{paced["tracker_ms"]:.1f}, {paced["servo_ms"]:.1f}, {paced["sum_ms"]:.1f}',
        f'{nodes["p50"] / paced["sum_ms"]:.2f}',
    ]


def _cost(title: str, name: str, it: Mapping[str, Any]) -> list[str]:
    memory = ' -> '.join(f'{each:.0f}' for each in it['memory_mb'])
    return [title, name, f'{it["processor_ms"]:.1f}', memory, f'{it["peak_mb"]:.0f}']


def _title(row: Mapping[str, Any]) -> str:
    width, height = row['size']
    return f'{width}x{height}, {row["rate"]:g} Hz'
