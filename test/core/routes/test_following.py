"""Following: which views are believed."""

import math

import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.routes.following import beside, beyond_gate
from visual_servo_epipolar.core.routes.path import TaughtPath
from visual_servo_epipolar.core.routes.steering import LateralFilter
from visual_servo_epipolar.core.routes.structure import ViewPose

WAY = np.linspace(0.0, 2.0, 21)
SURE = LateralFilter(np.zeros(3), np.diag([1e-8, 1e-8, 1e-8]))


def straight(heading: float) -> TaughtPath:
    """Return a straight path in a direction, as the camera of a key view sees it."""
    poses = np.stack([WAY * math.cos(heading), WAY * math.sin(heading), np.full(21, heading)], 1)
    return TaughtPath(WAY, poses, np.zeros(21), np.full(21, 0.5))


def seen(heading: float, offset: float, turn: float, along: FloatArray) -> ViewPose:
    """Return a place beside the middle of the path; ``along`` deviations are in its axes."""
    left = np.array([-math.sin(heading), math.cos(heading)])
    ahead = np.array([math.cos(heading), math.sin(heading)])
    axes = np.eye(3)
    axes[:2, 0], axes[:2, 1] = ahead, left
    covariance = axes @ np.diag(along**2) @ axes.T
    return ViewPose(np.append(ahead + offset * left, heading + turn), covariance, 40)


@pytest.mark.parametrize('heading', [0.0, 0.5 * math.pi, 2.0])
def test_the_gate_goes_by_the_deviations_across_the_path_and_of_the_turn(heading: float) -> None:
    path = straight(heading)
    # Uncertain along the way alone: that widens the gate of neither offset nor turn.
    along = np.array([0.5, 1e-3, 1e-3])
    assert not beyond_gate(SURE, beside(path, seen(heading, 0.0, 0.0, along), 1.0))
    assert beyond_gate(SURE, beside(path, seen(heading, 0.03, 0.0, along), 1.0))
    assert beyond_gate(SURE, beside(path, seen(heading, 0.0, 0.03, along), 1.0))
    # Uncertain across the way, or in its turn: that widens its own gate alone.
    across, turning = np.array([1e-3, 0.1, 1e-3]), np.array([1e-3, 1e-3, 0.1])
    assert not beyond_gate(SURE, beside(path, seen(heading, 0.03, 0.0, across), 1.0))
    assert beyond_gate(SURE, beside(path, seen(heading, 0.0, 0.03, across), 1.0))
    assert not beyond_gate(SURE, beside(path, seen(heading, 0.0, 0.03, turning), 1.0))
    assert beyond_gate(SURE, beside(path, seen(heading, 0.03, 0.0, turning), 1.0))


def test_what_is_not_believed_is_told_in_metres_and_radians() -> None:
    measured = beside(straight(0.0), seen(0.0, -0.25, 0.125, np.full(3, 1e-3)), 1.0)
    assert '-0.250 m and +0.125 rad off' in beyond_gate(SURE, measured)
