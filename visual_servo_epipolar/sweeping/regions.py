"""Regions of starts: where a sweep lets the robot begin."""

import numpy as np

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.simulation.scenario import Scenario

REGIONS = ('front', 'beside', 'anywhere')
BOXES = {'front': (-5.0, -2.0), 'beside': (-2.0, 1.5)}  # y [m]
START_STREAM = 5


def start_in(region: str, seed: int, index: int, scenario: Scenario) -> tuple[float, float, float]:
    """Return start number ``index``: x [m], y [m], heading error [deg]."""
    if region not in BOXES:
        raise InputError(f'region {region} is not there yet; use one of {", ".join(BOXES)}')
    rng = np.random.default_rng((seed, START_STREAM, index))
    low, high = BOXES[region]
    x, y, heading = rng.uniform((-1.5, low, -15.0), (1.5, high, 15.0)).tolist()
    return round(x, 6), round(y, 6), round(heading, 6)
