"""Dead reckoning: odometry that knows how far it may be off, and the frame it drifts away with."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.motion import (
    integrate,
    motion_between,
    Pose,
    Twist,
    wrap_angle,
)
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.simulation.bases import (
    DeadReckoning,
    Pioneer,
    PioneerSettings,
    world_to_odometry,
)

SETTINGS = PioneerSettings(command_timeout=0.0, odometry_noise=0.02)
FRAME_NS = 90_909_091
BEGIN = Pose(0.0, 0.0, 0.0)
places = st.floats(-5.0, 5.0)
poses = st.builds(Pose, places, places, st.floats(-math.pi + 1e-6, math.pi))


def drive(seed: int) -> DeadReckoning:
    """Drive a bend and back out of it, and return what the odometry says."""
    base = Pioneer(SETTINGS, BEGIN, seed=seed)
    reckoning = DeadReckoning(base.odometry, base.now_ns)
    for frame in range(44):
        base.command(Command(Twist(0.5, 0.4) if frame < 30 else Twist(-0.3, 0.2)))
        base.advance(base.now_ns + FRAME_NS)
        reckoning = reckoning.advanced(base.odometry, base.now_ns, noise=SETTINGS.odometry_noise)
    return reckoning


def test_the_covariance_is_that_of_many_drives() -> None:
    drives = [drive(seed) for seed in range(400)]
    x, y, theta = np.array([(d.pose.x, d.pose.y, d.pose.theta) for d in drives]).T
    scattered = np.cov([x, y, theta])
    told = np.mean([d.pose_covariance for d in drives], axis=0)
    # Of 400 drives a variance is known to 7 %: four of those. Whitened, so that all axes count.
    root = np.linalg.inv(np.linalg.cholesky(told))
    np.testing.assert_allclose(root @ scattered @ root.T, np.eye(3), atol=0.28)


def test_the_velocity_errs_as_its_covariance_says() -> None:
    offsets = []
    for seed in range(400):
        base = Pioneer(SETTINGS, BEGIN, seed=seed)
        base.command(Command(Twist(0.5, 0.4)))
        base.advance(30 * FRAME_NS)
        reckoning = DeadReckoning(base.odometry, base.now_ns)
        base.advance(31 * FRAME_NS)
        reckoning = reckoning.advanced(base.odometry, base.now_ns, noise=SETTINGS.odometry_noise)
        told = reckoning.twist.linear, reckoning.twist.angular
        error = np.subtract(told, (base.twist.linear, 0.4))
        offsets.append(error / np.sqrt(np.diag(reckoning.twist_covariance)))
    np.testing.assert_allclose(np.var(offsets, axis=0), 1.0, atol=0.28)
    np.testing.assert_allclose(np.mean(offsets, axis=0), 0.0, atol=0.2)


def test_uncertainty_grows_with_the_way_and_not_with_time() -> None:
    reckoning, variances = DeadReckoning(BEGIN, 0), []
    for step in range(1, 5):
        reckoning = reckoning.advanced(Pose(step, 0.0, 0.0), step, noise=0.1)
        variances.append(np.diag(reckoning.pose_covariance))
    assert (np.diff(variances, axis=0) > 0.0).all()
    # Var(x) = noise^2 L; var(theta) likewise; var(y) = noise^2 L^3 / 3, here in steps of L / 4.
    np.testing.assert_allclose(variances[-1][[0, 2]], 0.04)
    assert variances[-1][1] == pytest.approx(0.01 * 4.0**3 / 3.0, rel=0.05)
    waited = reckoning.advanced(reckoning.pose, 10**12, noise=0.1)
    np.testing.assert_allclose(waited.pose_covariance, reckoning.pose_covariance)
    np.testing.assert_allclose(waited.twist_covariance, 0.0)


def test_wheels_without_noise_are_certain() -> None:
    reckoning = DeadReckoning(BEGIN, 0).advanced(Pose(1.0, 0.2, 0.3), 10**9, noise=0.0)
    assert not reckoning.pose_covariance.any()
    assert not reckoning.twist_covariance.any()


def test_a_time_that_is_not_later_changes_nothing() -> None:
    reckoning = DeadReckoning(BEGIN, 5)
    assert reckoning.advanced(Pose(1.0, 0.0, 0.0), 5, noise=0.1) is reckoning


@given(before=poses, linear=st.floats(-1.0, 1.0), angular=st.floats(-3.0, 3.0))
def test_the_motion_between_two_poses_is_the_arc_that_was_driven(before, linear, angular) -> None:
    after = integrate(before, Twist(linear, angular), 1.0)
    assert motion_between(before, after) == pytest.approx((linear, angular), abs=1e-9)


@given(truth=poses, odometry=poses)
def test_odometry_in_the_world_is_the_truth(truth: Pose, odometry: Pose) -> None:
    origin = world_to_odometry(truth, odometry)
    sin, cos = math.sin(origin.theta), math.cos(origin.theta)
    x = origin.x + cos * odometry.x - sin * odometry.y
    y = origin.y + sin * odometry.x + cos * odometry.y
    assert (x, y) == pytest.approx((truth.x, truth.y), abs=1e-9)
    assert wrap_angle(origin.theta + odometry.theta - truth.theta) == pytest.approx(0.0, abs=1e-9)
