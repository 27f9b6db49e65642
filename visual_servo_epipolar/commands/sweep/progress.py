"""One line on how far a sweep is: outcomes so far, speed, and the time that is left."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
import time
from typing import Any

from visual_servo_epipolar.sweeping.summary import arrived, defective, wrong

BAR = 20  # width [characters]


class Tally:
    """
    Counts results as they come, out of ``total``; ``clock`` gives seconds.

    ``before`` was there already: it counts, but does not tell how fast the rest will go.
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
        """Take in results."""
        for result in results:
            self._counts['runs'] += 1
            self._counts['arrived' if arrived(result) else 'failed'] += 1
            self._counts['wrong'] += wrong(result)
            self._counts['raised'] += defective(result)

    def line(self) -> str:
        """Return bar, counts, runs a second, and time left."""
        runs = self._counts['runs']
        full = BAR * runs // self._total
        rate = (runs - self._before) / max(self._clock() - self._began, 1e-3)
        left = _minutes((self._total - runs) / rate) if rate else '?'
        counts = [f'{self._counts[name]} {name}' for name in ('arrived', 'failed')]
        counts += [f'{n} {name}' for name in ('wrong', 'raised') if (n := self._counts[name])]
        return (
            f'[{"#" * full}{"." * (BAR - full)}] {runs}/{self._total}  {"  ".join(counts)}  '
            f'{rate:.2g} runs/s  {left} left'
        )


def _minutes(seconds: float) -> str:
    hours, rest = divmod(round(seconds), 3600)
    minutes, seconds = divmod(rest, 60)
    return f'{hours}:{minutes:02d}:{seconds:02d}' if hours else f'{minutes}:{seconds:02d}'
