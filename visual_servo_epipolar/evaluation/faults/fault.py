"""Faults: what each is called, when it strikes, and the scene that it strikes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
import math
from typing import Any, Concatenate, ParamSpec

import numpy as np

from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.evaluation.faults.witness import Witness
from visual_servo_epipolar.evaluation.live.world import Envelope, Filter, World, WorldSettings

# Phases that nearly every run goes through, where the robot moves; a law without them has its own.
EVERYWHERE = (Phase.DISPLACING, Phase.ZEROING_EPIPOLES, Phase.MATCHING_FEATURES)
AT_FIRST = (Phase.WAITING,)
ALWAYS = (Phase.WAITING, *EVERYWHERE, Phase.ARRIVED)


@dataclass(slots=True)
class StruckRun:
    """The run that a fault strikes: its world, its witness, chance; ``notes`` say what is done."""

    world: World
    witness: Witness
    rng: np.random.Generator
    notes: list[str] = field(default_factory=list)
    busy_s: float = 0.0  # until then something is to happen

    def draw(self, low: float, high: float) -> float:
        """Draw a number between ``low`` and ``high``."""
        return float(self.rng.uniform(low, high))

    def hits(self, share: float) -> bool:
        """Draw whether one of a ``share`` is hit."""
        return bool(self.rng.random() < share)

    def side(self) -> float:
        """Draw a sign."""
        return 1.0 if self.hits(0.5) else -1.0

    def later(self, seconds: float, act: Callable[[], object]) -> None:
        """Let ``act`` happen in ``seconds`` from now."""
        wire = self.world.wire
        self.busy_s = max(self.busy_s, self.witness.now_s + seconds)
        wire.at(wire.now_ns + round(seconds * NANOSECONDS), act)

    def filter(self, topic: str, change: Filter, seconds: float = math.inf) -> None:
        """Let messages of ``topic`` go through ``change``, for ``seconds``."""
        filters = self.world.wire.filters[topic]
        filters.append(change)
        if seconds < math.inf:
            self.later(seconds, lambda: filters.remove(change))

    def alter(
        self, topic: str, change: Callable[[Any], object], seconds: float = math.inf
    ) -> None:
        """Let ``change`` alter each message of ``topic`` in place, for ``seconds``."""

        def altered(envelope: Envelope) -> list[Envelope]:
            change(envelope.message)
            return [envelope]

        self.filter(topic, altered, seconds)

    def lose(self, topic: str, seconds: float = math.inf) -> None:
        """Let no message of ``topic`` arrive, for ``seconds``."""
        self.filter(topic, lambda envelope: [], seconds)

    def note_stop(self) -> None:
        """Note that the robot is commanded now to stand for good."""
        self.witness.record.interventions.stopped_s = self.witness.now_s

    def spell(self, low: float, high: float) -> float:
        """Draw how long something lasts [s], and note it; half of the time it is for good."""
        seconds = math.inf if self.hits(0.5) else self.draw(low, high)
        self.notes.append('for good' if seconds == math.inf else f'for {seconds:.1f} s')
        return seconds


Strike = Callable[[StruckRun], object]
Prepare = Callable[[WorldSettings, np.random.Generator], WorldSettings]
What = ParamSpec('What')


def striking(act: Callable[Concatenate[StruckRun, What], object]) -> Callable[What, Strike]:
    """Return what makes strikes that ``act`` on a scene, from the other arguments of ``act``."""

    def strike_with(*what: What.args, **more: What.kwargs) -> Strike:
        return lambda scene: act(scene, *what, **more)

    return strike_with


def world_change(**changes: Any) -> Prepare:
    """Return a change of how a world is built."""
    return lambda settings, rng: replace(settings, **changes)


@dataclass(frozen=True)
class Fault:
    """
    A fault: ``strike`` does it to a scene, in one of the ``phases`` and some time into it.

    ``prepare`` changes the world before it is made, for what is wrong from the beginning. A fault
    in WAITING strikes before the first image. Where the servo cannot be heard, as ``base_alone``
    says, the base must stop by itself; elsewhere it may be one that does not.
    """

    what: str
    strike: Strike = lambda scene: None
    prepare: Prepare = lambda settings, rng: settings
    phases: tuple[Phase, ...] = EVERYWHERE
    base_alone: bool = False


Faults = Mapping[str, Fault]
always, at_first = partial(Fault, phases=ALWAYS), partial(Fault, phases=AT_FIRST)
