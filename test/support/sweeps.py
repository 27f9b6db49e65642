"""Sweeps small enough for a test: two seconds a run, or results made up."""

from pathlib import Path
from typing import Any

from visual_servo_epipolar.simulation.scenario import RunSettings, Scenario
from visual_servo_epipolar.sweeping.plan import Chunk, SweepPlan
from visual_servo_epipolar.sweeping.store import Store

BRIEF = Scenario(run=RunSettings(max_duration=2.0))


def plan_of(runs: int = 4, **changes: Any) -> SweepPlan:
    """Return a plan whose runs are cut off after two seconds, unless told otherwise."""
    plain = {'region': 'front', 'source': 'features', 'laws': ('full',), 'scenario': BRIEF}
    return SweepPlan(runs=runs, **{**plain, **changes})


def result(**changes: Any) -> dict[str, Any]:
    """Return the result of a run that arrived two millimetres and a twentieth of a degree off."""
    return {
        'outcome': 'arrived',
        'reason': 'matched',
        'start': [0.5, -3.0, 5.0],
        'seed': 1,
        'law': 'full',
        'position_error_m': 0.002,
        'lateral_error_m': -0.0015,
        'longitudinal_error_m': 0.001,
        'heading_error_deg': -0.05,
        'duration_s': 24.0,
        'path_length_m': 3.5,
        'max_distance_ratio': 1.0,
        'attempts': 1,
        'wrong_geometry_s': 0.0,
        **changes,
    }


def filled(folder: Path, plan: SweepPlan, results: list[dict[str, Any]]) -> Store:
    """Return a store that has ``results`` of the plan's first law."""
    store = Store(folder, plan)
    store.add(Chunk(plan.laws[0], tuple(range(len(results)))), results)
    return store
