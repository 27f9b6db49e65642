"""
Shrinkage: how much of what keyframes say of the photograph's rays a view near it does not confirm.

Keyframes correct the rays of the photograph, whose noise they average. What a tracker gets wrong,
though, is not noise: from afar a patch looks another, and is aligned with an error that is about
the same in all views, while near the goal, where the image is that of the photograph, there is
none. So a view near the goal tells by which share the corrections are to be withdrawn: by hardly
any where there is noise alone.
"""

from dataclasses import dataclass

ALIKE = 0.05  # of the depth: how near the goal views look as the photograph does
DRIFT = 0.04  # of the share, from view to view: what looks alike changes with the distance
LEAST_VARIANCE = 1e-6
# Shares up to which nothing, and from which all is withdrawn: noise alone makes some hundredths,
# and what features have in common, which displaces most, shows least in what they disagree on.
CHANCE, ALL = 0.2, 0.5


@dataclass(frozen=True, slots=True)
class Shrinkage:
    """The ``share`` of the corrections that views do not confirm, and its ``variance``."""

    share: float = 0.0
    variance: float = LEAST_VARIANCE

    @property
    def withdrawn(self) -> float:
        """Return the share that is withdrawn, from 0 to 1."""
        return min(max((self.share - CHANCE) / (ALL - CHANCE), 0.0), 1.0)

    def before(self, distance: float, depth: float) -> 'Shrinkage':
        """Return what is known before the next view, at a ``distance`` from the goal [m]."""
        if not distance < ALIKE * depth:
            return NOTHING
        return Shrinkage(self.share, min(self.variance + DRIFT * DRIFT, 1.0))


NOTHING = Shrinkage()


def shrinkage_of(share: float, variance: float) -> Shrinkage:
    """Return the shrinkage with an estimated ``share``, brought into its range of 0 to 1."""
    return Shrinkage(min(max(share, 0.0), 1.0), max(variance, LEAST_VARIANCE))
