"""Worlds of a repetition: what is another there than when the route was taught; by a seed."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.simulation.light.lights import FURNITURE, LAMPS, PICTURES, STOREY
from visual_servo_epipolar.simulation.scenario import Scenario

GAMMA = (0.4, 2.5)  # drawn evenly in its logarithm


@dataclass(frozen=True, slots=True)
class ChangedWorld:
    """
    A world: what has ``changed`` of the storey, whether its ``tones`` are of another gamma.

    ``people`` walk through the image; ``light`` is the share of the light that is left.
    """

    changed: str = 'none'
    tones: bool = False
    people: bool = False
    light: float = 1.0

    def of(self, scenario: Scenario, seed: int) -> Scenario:
        """Return a ``scenario`` in this world, drawn by ``seed``."""
        rng = np.random.default_rng((seed, 13))
        gamma = math.exp(float(rng.uniform(*np.log(GAMMA)))) if self.tones else 1.0
        light = replace(scenario.light, changed=self.changed, changed_seed=seed, gamma=gamma)
        height, since, still = float(rng.uniform(0.5, 1.0)), *rng.integers((20, 22), (70, 45))
        disturbances = replace(
            scenario.disturbances,
            disturbed_from=0 if self.light != 1.0 else int(since),
            disturbed_for=int(still),
            disturbed_every=int(still) + 60,
            person=height if self.people else 0.0,
            light_step=self.light - 1.0,
        )
        return replace(scenario, light=light, disturbances=disturbances)


WORLDS: Mapping[str, ChangedWorld] = {
    'light': ChangedWorld(LAMPS, tones=True),
    'pictures': ChangedWorld(PICTURES),
    'furniture': ChangedWorld(FURNITURE),
    'people': ChangedWorld(people=True),
    'all': ChangedWorld(STOREY, tones=True, people=True),
    'dim': ChangedWorld(light=0.08),
}


def world_of(scenario: Scenario, name: str, seed: int) -> Scenario:
    """Return a ``scenario`` in the world of that name; as it is in that called same."""
    return WORLDS[name].of(scenario, seed) if name in WORLDS else scenario
