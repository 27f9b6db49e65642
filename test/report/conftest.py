"""A plausible run in two steps, driven by the true geometry: no camera, no servo needed."""

from collections.abc import Iterator
import math

import pytest

from visual_servo_epipolar.core.geometry.motion import integrate, Pose, saturate, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.run_log import RunLog, Sample
from visual_servo_epipolar.core.stamps import NANOSECONDS

START = (-0.6, -3.0, 8.0)
FOCAL = 769.0
DEPTH = 4.0  # of the features from the goal [m]
DT = 1.0 / 11.0


def twist_towards_goal(phase: Phase, pose: Pose) -> Twist:
    """Turn away, drive onto the y axis, drive along it: the plain manner of the paper."""
    if phase is Phase.DISPLACING:
        return Twist(0.0, -0.3)
    if phase is Phase.ZEROING_EPIPOLES:
        steer = -1.2 * (pose.heading_error - max(-0.6, min(0.6, 1.4 * pose.x)))
        return saturate(Twist(0.25, steer), max_linear=0.3, max_angular=0.5)
    if phase is Phase.MATCHING_FEATURES:
        wanted = Twist(-0.7 * pose.y, -0.5 * pose.heading_error)
        return saturate(wanted, max_linear=0.3, max_angular=0.5)
    return Twist(0.0, 0.0)


def phase_after(phase: Phase, pose: Pose, step: int) -> Phase:
    """Switch as the servo would, on the truth."""
    if phase is Phase.WAITING and step >= 5:
        return Phase.DISPLACING
    if phase is Phase.DISPLACING and pose.heading_error < -0.45:
        return Phase.ZEROING_EPIPOLES
    if phase is Phase.ZEROING_EPIPOLES and abs(pose.x) < 0.004:
        return Phase.MATCHING_FEATURES
    if phase is Phase.MATCHING_FEATURES and abs(pose.y) < 0.002:
        return Phase.ARRIVED
    return phase


def sample_at(step: int, phase: Phase, pose: Pose, twist: Twist) -> Sample:
    """Measure what the servo would see from ``pose``."""
    psi = math.atan2(pose.y, pose.x)
    scale = 1.0 / DEPTH - 1.0 / (DEPTH - pose.y)
    return Sample(
        stamp_ns=round(step * DT * NANOSECONDS),
        pose=pose,
        twist=twist,
        phase=phase,
        features=round(60 - 8 * pose.distance + 2 * math.sin(step)),
        epipole_current=FOCAL * math.tan(pose.theta - psi),
        epipole_desired=FOCAL * pose.x / pose.y if pose.y else math.nan,
        feature_difference=-(FOCAL**2) * 30.0 * scale * (1.0 / DEPTH),
        feature_error=FOCAL * abs(scale) + FOCAL * abs(math.sin(pose.heading_error)) + 0.05,
        distance_estimate=1.3 * pose.distance if phase is Phase.ZEROING_EPIPOLES else math.nan,
    )


def steps() -> Iterator[Sample]:
    """Drive from the start until arrived, and stand there for a second."""
    pose, phase, standing = Pose.from_start(*START), Phase.WAITING, 0
    for step in range(600):
        phase = phase_after(phase, pose, step)
        twist = twist_towards_goal(phase, pose)
        yield sample_at(step, phase, pose, twist)
        pose = integrate(pose, twist, DT)
        standing += phase is Phase.ARRIVED
        if standing > 10:
            return


@pytest.fixture(scope='session')
def log() -> RunLog:
    """Return the run of ``steps``, which arrives."""
    return RunLog(START, 7, tuple(steps()), 'arrived', '')
