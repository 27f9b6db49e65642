"""
Soak: the four nodes as processes drive run after run; memory, threads and handles must stay.

A deadline is missed where no twist answers an image before the next image is due. Images before
the first answer and after the last are of no run: outside of one the servo is silent.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import TemporaryDirectory
import time
from typing import Any

from std_msgs.msg import String

from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.evaluation.benchmarks.speed.latency import CELLS
from visual_servo_epipolar.evaluation.live.chain import Answers, FourNodes
from visual_servo_epipolar.evaluation.live.processes import Cost, costs
from visual_servo_epipolar.evaluation.tables import aligned
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

OPTIONS = ('seconds',)  # of the command line that this benchmark takes
SECONDS, QUICK_SECONDS = 1800.0, 20.0
LONGEST_RUN_S = 90.0
LOOK_S = 0.2
CAMERA = replace(CELLS[0], frame_rate=10.0)
ENDS = (Phase.ARRIVED.value, Phase.FAILED.value)


class Runs(FourNodes):
    """Four nodes that are sent to the start again when a run has ended."""

    def __init__(self, stack: ExitStack, camera: CameraSettings, folder: Path) -> None:
        self._phase = ''
        super().__init__(stack, camera, folder)
        self.node.create_subscription(String, 'phase', self._on_phase, qos.LATCHED)

    def drive_until(self, deadline_s: float) -> tuple[Answers, str]:
        """Drive one run, to ``deadline_s`` [s] at the latest; return answers and last phase."""
        self.begin()
        self.wait(lambda: self._phase not in ENDS, 'the servo has begun no run')
        self.drive = drive = Answers()
        end_s = min(deadline_s, time.monotonic() + LONGEST_RUN_S)
        self.wait(lambda: len(drive.sent) > 1, 'no image was heard')
        while self._phase not in ENDS and time.monotonic() < end_s:
            self.spin_for(LOOK_S)
        return self.without_last_image(drive), self._phase

    def _on_phase(self, message: String) -> None:
        self._phase = str(message.data)


def run(
    *, seed: int, quick: bool, say: Callable[[str], None], seconds: float | None = None
) -> dict[str, Any]:
    """Return the document: each run with its ending, its deadlines, and what processes hold."""
    seconds = seconds or (QUICK_SECONDS if quick else SECONDS)
    camera = replace(CAMERA, seed=seed)
    rows: list[dict[str, Any]] = []
    with TemporaryDirectory(prefix='visual_servo_') as scratch, ExitStack() as stack:
        say('soak: starting nodes ...')
        nodes = Runs(stack, camera, Path(scratch))
        nodes.wait_for_answers()
        begin_s = time.monotonic()
        while not rows or time.monotonic() < begin_s + seconds:
            drive, phase = nodes.drive_until(begin_s + seconds)
            rows.append(_run_row(drive, phase, camera.frame_rate, costs(nodes.processes)))
            passed_s = rows[-1]['after_s'] = time.monotonic() - begin_s
            say(f'soak: {len(rows)} runs, {passed_s:.0f} of {seconds:g} s ...')
    size = [camera.width, camera.height]
    return {'size': size, 'rate': camera.frame_rate, 'seconds': seconds, 'runs': rows}


def _run_row(drive: Answers, phase: str, rate: float, held: Mapping[str, Cost]) -> dict[str, Any]:
    images = _of_run(drive, ended=phase in ENDS)
    in_time = sum(latency <= 1.0 / rate for latency in drive.latencies)
    return {
        'phase': phase,
        'arrived': phase == Phase.ARRIVED.value,
        'images': images,
        'missed': max(images - in_time, 0),
        'processes': {name: asdict(cost) for name, cost in held.items()},
    }


def _of_run(drive: Answers, *, ended: bool) -> int:
    """Return how many images a twist is due to: where a run has not ended, also the last ones."""
    first = min(drive.answered, default=0)
    last = max(drive.answered, default=0) if ended else max(drive.sent)
    return sum(first <= stamp_ns <= last for stamp_ns in drive.sent)


COLUMNS = 'after the first run -> the last | memory MB | threads | handles'
HELD = ('memory_mb', 'threads', 'handles')


def figures(document: Mapping[str, Any]) -> dict[str, float]:
    """Return what to compare between soaks; less is better."""
    grown = {
        f'{name} grows by [MB]': last['memory_mb'] - first['memory_mb']
        for name, first, last in _ends(document)
    }
    return {'missed deadlines [%]': 1e2 * _missed_share(document), **grown}


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: endings and deadlines, then what each process holds."""
    runs, (width, height) = document['runs'], document['size']
    endings = Counter(run['phase'] for run in runs)
    return '\n'.join(
        [
            f'Soak: {len(runs)} runs of four processes in {runs[-1]["after_s"]:.0f} s, '
            f'{width}x{height} at {document["rate"]:g} Hz',
            'ended in ' + ', '.join(f'{phase}: {count}' for phase, count in endings.items()),
            f'{sum(run["images"] for run in runs)} images, {_missed_share(document):.2%} of them '
            'without a twist before the next image is due',
            '',
            *aligned(COLUMNS, (_held(*ends) for ends in _ends(document))),
        ]
    )


def _missed_share(document: Mapping[str, Any]) -> float:
    runs = document['runs']
    return float(sum(run['missed'] for run in runs) / sum(run['images'] for run in runs))


def _ends(document: Mapping[str, Any]) -> list[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Return each process, what it held after the first run and after the last."""
    first, last = (document['runs'][index]['processes'] for index in (0, -1))
    return [(name, first[name], last[name]) for name in first]


def _held(name: str, first: Mapping[str, Any], last: Mapping[str, Any]) -> list[str]:
    return [name, *(f'{first[key]:.0f} -> {last[key]:.0f}' for key in HELD)]
