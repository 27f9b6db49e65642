"""Which strips of an image each of two processes draws."""

from visual_servo_epipolar.simulation.rendering.raster import Raster

MAIN, ASSISTANT = 0, 1
STRIP = 10_000  # samples that take as long as a strip takes besides
UNEVEN = 0.1  # of all work: by how much one may have more, for a surface to stay where it is

Numbers = tuple[frozenset[int], frozenset[int]]


class Sharing:
    """
    Shares of two processes; where both are asked for the same rasters, they give the same answers.

    A surface mostly stays with one process: its pictures are blurred and reduced by who draws it.
    """

    def __init__(self) -> None:
        self._owners: dict[int, int] = {}

    def shares(self, raster: Raster, spared: float) -> Numbers:
        """
        Return the numbers of the strips, from 1, that main process and assistant draw.

        The main process gets less by ``spared``, of all work.
        """
        costs: dict[int, int] = {}
        for strip, (left, top, right, bottom) in zip(raster.strips, raster.boxes, strict=True):
            samples = (right - left) * (bottom - top) * strip.columns * strip.rows
            costs[strip.surface] = costs.get(strip.surface, 0) + STRIP + samples
        total = sum(costs.values())
        work = [max(spared, 0.0) * total, max(-spared, 0.0) * total]
        for surface in sorted(costs, key=lambda it: (-costs[it], it)):
            least = work.index(min(work))
            owner = self._owners.get(surface, least)
            if work[owner] - work[least] + costs[surface] > (1.0 + UNEVEN) * total / 2.0:
                owner = least
            self._owners[surface] = owner
            work[owner] += costs[surface]
        numbers: tuple[list[int], list[int]] = [], []
        for number, strip in enumerate(raster.strips, start=1):
            numbers[self._owners[strip.surface]].append(number)
        return frozenset(numbers[MAIN]), frozenset(numbers[ASSISTANT])
