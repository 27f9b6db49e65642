"""Progress of a sweep in one line: outcomes, speed, and the remaining time."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
import time
from typing import Any

from visual_servo_epipolar.sweeping.summary import arrived, defective, wrong

BAR = 20  # width [characters]


class SweepProgress:
    """
    Progress of a sweep out of ``total`` runs; ``clock`` gives seconds.

    ``before`` are results of an earlier session: they count, but say nothing about the speed.
    """

    def __init__(
        self,
        total: int,
        before: Iterable[Mapping[str, Any]] = (),
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._total, self._clock, self._began = total, clock, clock()
        self._counts: Counter[str] = Counter()
        self.add(before)
        self._before = self._counts['runs']

    def add(self, results: Iterable[Mapping[str, Any]]) -> None:
        """Count results."""
        for result in results:
            self._counts['runs'] += 1
            self._counts['arrived' if arrived(result) else 'failed'] += 1
            self._counts['wrong'] += wrong(result)
            self._counts['raised'] += defective(result)

    def line(self) -> str:
        """Return bar, counts, runs a second, and remaining time."""
        runs = self._counts['runs']
        filled = BAR * runs // self._total
        rate = (runs - self._before) / max(self._clock() - self._began, 1e-3)
        remaining = _minutes((self._total - runs) / rate) if rate else '?'
        counts = [f'{self._counts[name]} {name}' for name in ('arrived', 'failed')]
        counts += [f'{n} {name}' for name in ('wrong', 'raised') if (n := self._counts[name])]
        return (
            f'[{"#" * filled}{"." * (BAR - filled)}] {runs}/{self._total}  {"  ".join(counts)}  '
            f'{rate:.2g} runs/s  {remaining} left'
        )


def _minutes(seconds: float) -> str:
    hours, rest = divmod(round(seconds), 3600)
    minutes, seconds = divmod(rest, 60)
    return f'{hours}:{minutes:02d}:{seconds:02d}' if hours else f'{minutes}:{seconds:02d}'
