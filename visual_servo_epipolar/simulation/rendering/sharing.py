"""Which strips of an image each of two processes draws."""

from visual_servo_epipolar.simulation.rendering.raster import Raster
from visual_servo_epipolar.simulation.rendering.strips import Strip

MAIN, ASSISTANT = 0, 1
STRIP = 10_000  # samples that take as long as a strip takes besides
UNEVEN = 0.04  # of all work: by how much one may have more, for a strip to stay where it is

Numbers = tuple[frozenset[int], frozenset[int]]


class Sharing:
    """
    Shares of two processes; where both are asked for the same rasters, they give the same answers.

    A strip mostly stays with one process, which has its texels in its cache.
    """

    def __init__(self) -> None:
        self._owners: dict[Strip, int] = {}

    def shares(self, raster: Raster, spared: float) -> Numbers:
        """
        Return the numbers of the strips, from 1, that main process and assistant draw.

        The main process gets less by ``spared``, of all work.
        """
        costs = [
            STRIP + (right - left) * (bottom - top) * strip.columns * strip.rows
            for strip, (left, top, right, bottom) in zip(raster.strips, raster.boxes, strict=True)
        ]
        total = sum(costs)
        work = [max(spared, 0.0) * total, max(-spared, 0.0) * total]
        most = 0.5 * (sum(work) + (1.0 + UNEVEN) * total)
        numbers: tuple[list[int], list[int]] = [], []
        owners: dict[Strip, int] = {}
        for number in sorted(range(len(costs)), key=lambda it: (-costs[it], it)):
            strip, least = raster.strips[number], work.index(min(work))
            owner = self._owners.get(strip, least)
            if work[owner] + costs[number] > most:
                owner = least
            owners[strip] = owner
            work[owner] += costs[number]
            numbers[owner].append(number + 1)
        self._owners = owners
        return frozenset(numbers[MAIN]), frozenset(numbers[ASSISTANT])
