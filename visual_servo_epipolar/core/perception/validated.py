"""Whether the geometries of many views are believed, and what is remembered of them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimators.base import Estimate, Prior
from visual_servo_epipolar.core.estimators.registry import estimates
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.rotation import RotationFits
from visual_servo_epipolar.core.perception.measurement import Glimpse, Observation
from visual_servo_epipolar.core.perception.validation import (
    Evidence,
    evidence,
    fresh_memory,
    Memory,
    rejection_reason,
    remembered,
)

NOISE_ADAPTION = 0.1
NOISE_RANGE = (0.2, 5.0)  # of the noise that the settings give to begin with


class Stack(NamedTuple):
    """Glimpses of equally many features: unit rays, shape (B, N, 3), and their best rotations."""

    glimpses: Sequence[Glimpse]
    current: FloatArray
    desired: FloatArray
    rotations: RotationFits

    def take(self, rows: Sequence[int]) -> 'Stack':
        """Return the glimpses in ``rows``, which ascend."""
        if len(rows) == len(self.glimpses):
            return self
        chosen = np.array(rows)
        return Stack(
            [self.glimpses[row] for row in rows],
            self.current[chosen],
            self.desired[chosen],
            RotationFits(*(part[chosen] for part in self.rotations)),
        )


class Verdict(NamedTuple):
    """What is believed of the geometry of one glimpse, or why nothing is, and the memory of it."""

    memory: Memory
    reason: str
    estimate: Estimate | None = None
    shown: Evidence | None = None

    @property
    def bearings(self) -> Bearings | None:
        """The bearings, if they can be trusted."""
        return None if self.reason or self.estimate is None else self.estimate.bearings


def verdicts(stack: Stack) -> list[Verdict]:
    """Return what is believed of each geometry; a small parallax shows none."""
    found, wide = [], []
    parallax = stack.rotations.parallax.tolist()
    for k, (observation, settings, _, memory) in enumerate(stack.glimpses):
        parallax_px, reason = parallax[k] * observation.focal, ''
        if parallax_px < settings.min_parallax:
            reason = f'a parallax of {parallax_px:.2f} px is too small for epipoles'
        else:
            wide.append(k)
        found.append(Verdict(memory or fresh_memory(settings), reason))
    if wide:
        memories = [found[k].memory for k in wide]
        for k, verdict in zip(wide, _judged(stack.take(wide), memories), strict=True):
            found[k] = verdict
    return found


def _judged(stack: Stack, memories: Sequence[Memory]) -> list[Verdict]:
    """Return what is believed of geometries that show parallax."""
    glimpses = stack.glimpses
    noise = np.array([memory.noise for memory in memories])
    resolution = np.array([glimpse.observation.resolution for glimpse in glimpses])
    answers = estimates(
        glimpses[0].settings.estimator,
        stack.current,
        stack.desired,
        noise=noise[:, None, None] * resolution,
        priors=[
            Prior(memory.attitude, memory.bearings, glimpse.settings.max_leap, memory.lens)
            for memory, glimpse in zip(memories, glimpses, strict=True)
        ],
        seeds=[(glimpse.settings.seed, glimpse.frame) for glimpse in glimpses],
    )
    seen = {k: answer for k, answer in enumerate(answers) if isinstance(answer, Estimate)}
    shown: dict[int, Evidence] = {}
    if seen:
        some = stack.take(list(seen))
        found = evidence(list(seen.values()), some.current, some.desired, resolution[list(seen)])
        shown = dict(zip(seen, found, strict=True))
    parallax = stack.rotations.parallax.tolist()
    return [
        _verdict(glimpse, memory, answer, shown[k], parallax[k])
        if isinstance(answer, Estimate)
        else Verdict(memory, str(answer))
        for k, (glimpse, memory, answer) in enumerate(
            zip(glimpses, memories, answers, strict=True)
        )
    ]


def _verdict(
    glimpse: Glimpse, memory: Memory, estimate: Estimate, shown: Evidence, parallax: float
) -> Verdict:
    """Return whether ``estimate`` is believed, and what is remembered of it."""
    observation, settings = glimpse.observation, glimpse.settings
    reason = rejection_reason(estimate, shown, memory, settings)
    after = remembered(
        memory,
        estimate,
        reason,
        noise=_noise(shown.residual, observation, memory.noise, settings.pixel_noise),
        parallax=parallax * observation.focal,
    )
    return Verdict(after, reason, estimate, shown)


def _noise(residual: float, observation: Observation, before: float, first: float) -> float:
    """Return the deviation of a coordinate [px], slowly following the median ``residual`` [px]."""
    spare = max(len(observation.current) - 2, 1)
    now = 1.4826 * (1.0 + 5.0 / spare) * residual
    followed = before + NOISE_ADAPTION * (now - before)
    return min(max(followed, NOISE_RANGE[0] * first), NOISE_RANGE[1] * first)
