"""Robots drawn at random over the ranges of those that people own: every one of them ends."""

import math
from typing import Any

from durations import few_of
import numpy as np
import pytest

from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.simulation.scenario import from_document
from visual_servo_epipolar.simulation.views import drive

LIMIT = 0.19  # widest dead band over the limit of the speed: a fifth is what the servo learns


def robot(seed: int, law: str) -> tuple[dict[str, Any], tuple[float, float, float]]:
    """Return the scenario of a robot, and its start; half of its nuisances are there."""
    rng = np.random.default_rng(seed)

    def within(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def scale(low: float, high: float) -> float:
        return math.exp(within(math.log(low), math.log(high)))

    def maybe(value: float, chance: float = 0.5) -> float:
        return value if rng.uniform() < chance else 0.0

    speed, turn = min(scale(0.25, 1.0), 0.4), min(scale(0.6, 2.5), 0.5)
    base = {
        'acceleration': scale(0.25, 2.0),
        'deceleration': scale(0.5, 2.0),
        'angular_acceleration': scale(1.0, 6.0),
        'slip': maybe(within(0.0, 0.1)),
        'wheel_ratio': within(0.98, 1.02),
        'dead_zone_linear': maybe(min(within(0.005, 0.05), LIMIT * speed)),
        'dead_zone_angular': maybe(min(within(0.01, 0.15), LIMIT * turn)),
        'command_delay': maybe(within(0.02, 0.35)),
        'step_linear': maybe(within(0.002, 0.015), 0.3),
        'step_angular': maybe(within(0.005, 0.03), 0.3),
        'caster_kick': maybe(within(0.0, 0.025), 0.3),
        'nod': maybe(within(0.0, 0.0175), 0.3),
    }
    tilt, forward = maybe(within(-0.1, 0.2)), maybe(within(-0.15, 0.25))
    camera = {
        'width': 640,
        'height': 480,
        'focal_length': scale(250.0, 700.0),
        'principal_u': 320.0 + within(-6.0, 6.0),
        'principal_v': 240.0 + within(-6.0, 6.0),
        'frame_rate': scale(5.0, 30.0),
        'readout': maybe(within(0.005, 0.033)),
        'shutter': maybe(within(0.003, 0.025)),
        'stamp_delay': maybe(within(0.01, 0.2)),
        'stamp_jitter': maybe(within(0.0, 0.02)),
        'tilt': tilt,
        'roll': maybe(within(-0.02, 0.02)),
        'jitter': maybe(within(0.0, 0.003), 0.3),
        'bumps': maybe(within(0.0, 0.006), 0.3),
        'breathing': maybe(within(0.0, 0.0025), 0.2),
        'believed_focal_ratio': within(0.98, 1.02),
        'believed_shift_u': within(-4.0, 4.0),
        'believed_shift_v': within(-4.0, 4.0),
        'mount_forward': forward,
        'mount_yaw': maybe(within(-0.04, 0.04)),
    }
    servo = {
        'law': law,
        'max_linear': speed,
        'max_angular': turn,
        'camera_tilt': tilt + float(rng.normal(0.0, 0.01)),
        'camera_forward': forward + float(rng.normal(0.0, 0.01)),
    }
    points = {'noise': within(0.1, 0.5), 'outlier_ratio': maybe(within(0.0, 0.3), 0.3)}
    document = {'base': base, 'camera': camera, 'points': points, 'servo': servo}
    return document, (within(-1.5, 1.5), -within(1.5, 5.0), within(-20.0, 20.0))


@pytest.mark.parametrize('law', ['full', 'smooth'])
@pytest.mark.parametrize('seed', few_of([*range(42), 174, 191], keep=(0, 1, 34, 41, 42, 43)))
def test_a_robot_of_these_ranges_arrives(seed, law) -> None:
    document, start = robot(seed, law)
    summary = summarise(drive(from_document(document, 'robot').seeded(seed), start, seed))
    assert summary['outcome'] == 'arrived', summary['reason']
    assert summary['position_error_m'] < 0.015
    assert abs(summary['heading_error_deg']) < 1.0
    assert summary['standing_s'] < 15.0
