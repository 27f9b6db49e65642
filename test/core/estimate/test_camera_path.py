"""The path of a camera beside the axle, forward and back: exact, with its derivatives."""

from dataclasses import replace
import math

from hypothesis import assume, given
from mounted import camera_pose, NOISE, of_camera_axes
import numpy as np
import pytest
from strategies import angles, floats, poses

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimate.extrinsics import (
    configured_extrinsics,
    Extrinsics,
    FORWARD,
    moved,
    PSI,
    seen,
)
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import integrate, Twist, wrap_angle
from visual_servo_epipolar.core.rigs.fixed_mount import at_axle


def moving(psi: float, rho: float, mount: FloatArray, heading: float, travel: float) -> Extrinsics:
    """Return a belief that is about to move, with a covariance of full rank."""
    root = np.random.default_rng(1).standard_normal((5, 5))
    begun = configured_extrinsics(mount, np.full(3, 0.1))
    return replace(
        begun,
        mean=np.array([psi, rho, *mount]),
        covariance=root @ root.T,
        heading=heading,
        travel=travel,
        placed=True,
    )


@given(
    psi=angles(),
    rho=floats(-0.5, 1.5),
    yaw=floats(-0.5, 0.5),
    forward=floats(-0.4, 0.4),
    heading=floats(-0.5, 0.5),
    turn=floats(-0.4, 0.4),
    travel=floats(-0.3, 0.3),
)
def test_the_covariance_moves_by_its_slopes(psi, rho, yaw, forward, heading, turn, travel) -> None:
    mount = np.array([yaw, forward, 0.1])
    before = moving(psi, rho, mount, heading, travel)
    after = moved(before, heading + turn)
    assume(after.distance > 0.1)
    step = 1e-6
    columns = []
    for k in range(5):
        shift = step * np.eye(5)[k]
        ends = [
            moved(replace(before, mean=before.mean + side * shift), heading + turn).mean
            for side in (1.0, -1.0)
        ]
        columns.append((ends[0] - ends[1]) / (2.0 * step))
    jacobian = np.column_stack(columns)
    # Whatever is added is noise of the path, which does not depend on the covariance.
    noise = moved(replace(before, covariance=np.zeros((5, 5))), heading + turn).covariance
    expected = jacobian @ before.covariance @ jacobian.T + noise
    np.testing.assert_allclose(after.covariance, expected, rtol=1e-4, atol=1e-4)


WAYS = floats(-0.5, 0.5).map(lambda travel: Twist(travel, 0.0))
TURNS = floats(0.1, 0.8).map(lambda turn: Twist(0.0, turn))


@given(poses(min_baseline=0.3), floats(-0.3, 0.3), floats(-0.3, 0.3), WAYS | TURNS)
def test_moved_is_the_exact_path_of_the_camera(base, yaw, forward, twist) -> None:
    mount = np.array([yaw, forward, 0.1])
    camera = camera_pose(base, mount)
    then = camera_pose(integrate(base, twist, 1.0), mount)
    assume(min(camera.distance, then.distance) > 0.1)
    first, last = Bearings.from_pose(camera), Bearings.from_pose(then)
    belief = moving(
        first.psi,
        math.log(camera.distance),
        of_camera_axes(mount),
        first.heading_error,
        twist.linear,
    )
    after = moved(belief, last.heading_error)
    assert after.distance == pytest.approx(then.distance, rel=1e-9)
    assert wrap_angle(float(after.mean[PSI]) - last.psi) == pytest.approx(0.0, abs=1e-9)


@given(
    poses(min_baseline=0.3),
    floats(-1.0, 1.0),
    floats(-0.5, 0.5),
    floats(-0.5, 0.5),
)
def test_the_bearings_of_the_camera_give_those_of_the_axle(base, yaw, forward, left) -> None:
    mount = np.array([yaw, forward, left])
    camera = camera_pose(base, mount)
    assume(camera.distance > 0.05)
    axle = at_axle(Bearings.from_pose(camera), of_camera_axes(mount), camera.distance)
    true = Bearings.from_pose(base)
    assert wrap_angle(axle.psi - true.psi) == pytest.approx(0.0, abs=1e-9)
    assert wrap_angle(axle.phi - true.phi) == pytest.approx(0.0, abs=1e-9)


def test_a_bearing_makes_no_deviation_larger() -> None:
    before = moving(-1.5, 1.0, np.array([0.0, 0.2, 0.0]), 0.0, 0.1)
    after, innovation = seen(before, -1.4, NOISE)
    assert innovation > 0.0
    assert (after.covariance.diagonal() <= before.covariance.diagonal()).all()
    assert after.mean[PSI] == pytest.approx(-1.4, abs=1e-3)
    assert after.mean[FORWARD] != before.mean[FORWARD]
