"""
How many closed loops on point features one core does in a second, alone and side by side.

It is the time of the thread on its processor: what else the machine does meanwhile counts only
where it shares caches and arithmetic units with us.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from time import thread_time
from typing import Any

from visual_servo_epipolar.core.servo.run_log import RunLog
from visual_servo_epipolar.core.settings import updated
from visual_servo_epipolar.evaluation.benchmarks.arrivals.starts import runs_on_points
from visual_servo_epipolar.evaluation.tables import aligned
from visual_servo_epipolar.simulation.closed_loop import PARTS, run_many
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.sweeping.plan import Run

BATCHES = (1, 16, 64)
FEWEST = {1: 12}  # runs in a batch of one: it takes long enough
RUNS = 32  # in other batches, where they are not larger
REGION = 'front'
TWO_VIEWS = {'law': 'full-memory'}


def _rough() -> Scenario:
    """Return a scenario in which shortcuts of the computation are rarer."""
    plain = Scenario()
    return replace(
        plain,
        base=updated(plain.base, {'wheel_ratio': 1.01, 'command_delay': 0.0909}, 'base'),
        camera=replace(plain.camera, jitter=0.0017, tilt=0.0175),
        points=replace(plain.points, outlier_ratio=0.1),
    )


# As a user has them, with the memory of views; and by two views alone.
SCENARIOS: Mapping[str, Scenario] = {
    'nominal': Scenario(),
    'rough': _rough(),
    'nominal, two views': Scenario().with_servo(TWO_VIEWS),
}


class Stopwatch:
    """Adds up what the parts of the rounds take."""

    def __init__(self) -> None:
        self.seconds = dict.fromkeys(PARTS, 0.0)
        self._began = thread_time()

    def lap(self, part: str) -> None:
        """Count the time since the last lap for ``part``."""
        now = thread_time()
        self.seconds[part] += now - self._began
        self._began = now


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Return loops a second and what they are spent on, for each scenario and batch."""
    batches = (1, 4) if quick else BATCHES
    document: dict[str, Any] = {'seed': seed, 'region': REGION, 'scenarios': []}
    for name, scenario in SCENARIOS.items():
        rows, records = [], []
        for batch in batches:
            count = batch if quick else FEWEST.get(batch, max(batch, RUNS))
            say(f'sweep, {name}: {count} runs, {batch} at a time')
            row, digests = _measure_batch(runs_on_points(scenario, REGION, count, seed), batch)
            rows.append(row)
            records.append(digests)
        document['scenarios'].append(
            {'scenario': name, 'batches': rows, 'identical': _agree(records)}
        )
    return document


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: rates, and where the time goes."""
    lines = [
        f'Closed loops on point features, region {document["region"]}, 60 features, one core',
    ]
    head = ' | '.join(('batch', 'loops/s', 'steps', 'us/step', *PARTS, 'arrived'))
    for it in document['scenarios']:
        alike = 'the same' if it['identical'] else 'NOT THE SAME'
        lines += ['', f'{it["scenario"]}: records of one run are {alike} in every batch']
        lines += aligned(head, map(_cells, it['batches']))
    return '\n'.join(lines)


def figures(document: Mapping[str, Any]) -> dict[str, float]:
    """Return what to compare between runs; less is better."""
    return {
        f'{it["scenario"]}, {row["batch"]} at a time, processor time of a step [us]': row[
            'step_us'
        ]
        for it in document['scenarios']
        for row in it['batches']
    }


def _measure_batch(runs: Sequence[Run], batch: int) -> tuple[dict[str, Any], list[str]]:
    """Return what ``runs`` cost, ``batch`` at a time, and a digest of each record."""
    watch, logs, began = Stopwatch(), [], thread_time()
    for first in range(0, len(runs), batch):
        logs += run_many(runs[first : first + batch], lap=watch.lap)
    seconds = thread_time() - began
    steps = sum(len(log.samples) for log in logs)
    row = {
        'batch': batch,
        'runs': len(runs),
        'loops_per_s': len(runs) / seconds,
        'steps_per_loop': steps / len(runs),
        'step_us': 1e6 * seconds / steps,
        'parts_us': {part: 1e6 * time / steps for part, time in watch.seconds.items()},
        'arrived': sum(log.outcome == 'arrived' for log in logs),
    }
    return row, [_digest(log) for log in logs]


def _digest(log: RunLog) -> str:
    # By text, as what could not be seen is nan; every digit of every sample counts.
    return sha256(repr(log).encode()).hexdigest()


def _agree(records: Sequence[Sequence[str]]) -> bool:
    """Return whether the records of a run are the same wherever it was driven."""
    shortest = min(map(len, records))
    return len({tuple(digests[:shortest]) for digests in records}) == 1


def _cells(row: Mapping[str, Any]) -> list[str]:
    return [
        *(str(row['batch']), f'{row["loops_per_s"]:.1f}', f'{row["steps_per_loop"]:.0f}'),
        f'{row["step_us"]:.0f}',
        *(f'{row["parts_us"][part]:.1f} us' for part in PARTS),
        f'{row["arrived"]}/{row["runs"]}',
    ]
