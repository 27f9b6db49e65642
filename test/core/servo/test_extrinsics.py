"""The camera's place on the base, learnt: from drives by exact kinematics, without images."""

from collections.abc import Iterator
from dataclasses import replace
import math

from hypothesis import assume, given
import numpy as np
import pytest
from strategies import angles, floats, poses

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, Twist, wrap_angle
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.servo.extrinsics import (
    at_axle,
    Extrinsics,
    FORWARD,
    learnt,
    moved,
    NEAR,
    placed,
    PSI,
    RHO,
    seen,
    told_extrinsics,
    UNCERTAIN,
    YAW,
)
from visual_servo_epipolar.core.servo.settings import ServoSettings

NOISE = 1e-3  # of a bearing [rad]
PERIOD = 0.1  # between two images [s]
ON_AXLE = np.zeros(3)
START = Pose.from_start(0.8, -3.0, 5.0)
# Turns in place to both sides, then a bend to and fro: speeds [m/s, rad/s] and how long [s].
DRIVE = [
    (Twist(0.0, 0.4), 1.0),
    (Twist(0.0, -0.4), 2.0),
    (Twist(0.0, 0.4), 1.0),
    (Twist(0.3, 0.15), 3.0),
    (Twist(0.3, -0.2), 3.0),
    (Twist(-0.3, 0.15), 3.0),
    (Twist(0.0, 0.4), 1.0),
    (Twist(0.0, -0.4), 1.0),
]
MOUNTS = [
    np.array([math.radians(5.0), 0.25, 0.0]),
    np.array([math.radians(-4.0), -0.2, 0.0]),
    np.array([math.radians(3.0), 0.3, 0.05]),
]


def rotated(x: float, y: float, angle: float) -> tuple[float, float]:
    cosine, sine = math.cos(angle), math.sin(angle)
    return cosine * x - sine * y, sine * x + cosine * y


def camera_pose(base: Pose, mount: FloatArray) -> Pose:
    """Return the camera of ``base``, in axes of the camera of a base that stands at the goal."""
    yaw, *lever = mount.tolist()
    x, y = rotated(*lever, base.theta)
    goal_x, goal_y = rotated(*lever, math.pi / 2.0)
    return Pose(*rotated(base.x + x - goal_x, base.y + y - goal_y, -yaw), base.theta)


def of_camera_axes(mount: FloatArray) -> FloatArray:
    """Return ``mount`` with its lever arm, which is given in axes of the base, in the camera's."""
    yaw, *lever = mount.tolist()
    return np.array([yaw, *rotated(*lever, -yaw)])


def sight(bearings: Bearings, *, deviation: float = NOISE) -> Measurement:
    return Measurement(
        0,
        40,
        769.0,
        0.3,
        bearings=bearings,
        deviation=deviation,
        heading_error=bearings.heading_error,
    )


def frames(
    mount: FloatArray, *, start: Pose = START, seed: int = 0
) -> Iterator[tuple[Measurement, float, float]]:
    """Yield of each image of DRIVE what is measured, the travel before, the true distance."""
    rng = np.random.default_rng(seed)
    base, travel = start, 0.0
    twists = [twist for twist, duration in DRIVE for _ in range(round(duration / PERIOD))]
    for twist in [*twists, Twist(0.0, 0.0)]:
        camera = camera_pose(base, mount)
        true = Bearings.from_pose(camera)
        noise, turn = (NOISE * rng.standard_normal(2)).tolist()
        yield (
            sight(Bearings(true.psi + noise, true.phi + noise + 0.3 * turn)),
            travel,
            camera.distance,
        )
        base, travel = integrate(base, twist, PERIOD), twist.linear * PERIOD


def unknown(told: FloatArray = ON_AXLE) -> Extrinsics:
    """Return what the default settings know of a mount that is ``told``."""
    yaw, forward, left = told.tolist()
    return ServoSettings(camera_yaw=yaw, camera_forward=forward, camera_left=left).extrinsics


def beliefs(
    mount: FloatArray, belief: Extrinsics, *, missed: bool = False, seed: int = 0
) -> Iterator[tuple[Extrinsics, float]]:
    """Yield the belief after each image of DRIVE, and the true distance [m]."""
    for measurement, travel, distance in frames(mount, seed=seed):
        belief = learnt(belief, measurement, travel, missed=missed)
        yield belief, distance


def test_what_is_told_is_where_learning_begins() -> None:
    settings = ServoSettings(
        camera_yaw=0.1,
        camera_forward=0.2,
        camera_left=-0.3,
        camera_yaw_deviation=0.01,
        camera_forward_deviation=0.02,
        camera_left_deviation=0.03,
    )
    np.testing.assert_array_equal(settings.extrinsics.mount, [0.1, 0.2, -0.3])
    np.testing.assert_array_equal(settings.extrinsics.mean[YAW:], [0.1, 0.2, -0.3])
    deviations = np.sqrt(settings.extrinsics.covariance.diagonal()[YAW:])
    np.testing.assert_allclose(deviations, [0.01, 0.02, 0.03])


@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize('mount', MOUNTS)
def test_a_drive_tells_the_mount_and_the_distance(mount: FloatArray, seed: int) -> None:
    *_, (belief, distance) = beliefs(mount, unknown(), seed=seed)
    assert belief.believed
    assert belief.mount[0] == pytest.approx(mount[0], abs=math.radians(1.0))
    assert belief.mount[1] == pytest.approx(mount[1], abs=0.03)
    assert belief.is_ranged
    assert belief.distance == pytest.approx(distance, rel=0.1)


@pytest.mark.parametrize('missed', [False, True])
@pytest.mark.parametrize('seed', range(6))
def test_a_camera_on_the_axle_is_left_there(seed: int, missed: bool) -> None:
    learning = list(beliefs(ON_AXLE, unknown(), missed=missed, seed=seed))
    assert not any(belief.believed for belief, _ in learning)
    np.testing.assert_array_equal(learning[-1][0].mount, ON_AXLE)


@pytest.mark.parametrize('mount', MOUNTS)
def test_a_mount_that_is_told_right_is_left_as_told(mount: FloatArray) -> None:
    *_, (belief, _) = beliefs(mount, unknown(mount))
    assert not belief.believed
    np.testing.assert_array_equal(belief.mount, mount)


@pytest.mark.parametrize('mount', [ON_AXLE, *MOUNTS])
def test_bearings_that_commands_explain_never_contradict(mount: FloatArray) -> None:
    assert {belief.contradictions for belief, _ in beliefs(mount, unknown())} == {0}


def test_bearings_that_jump_about_contradict_what_is_driven() -> None:
    belief, rng = unknown(), np.random.default_rng(3)
    contradicted = []
    for measurement, travel, _ in frames(ON_AXLE):
        bearings = measurement.bearings
        assert bearings is not None
        jump = rng.uniform(-1.5, 1.5)
        wrong = Bearings(bearings.psi + jump, bearings.phi + jump)  # the heading is right
        belief = learnt(belief, sight(wrong), travel, missed=False)
        contradicted.append(belief.contradicts)
    assert any(contradicted)


def test_one_jump_is_forgiven_and_the_path_begins_anew() -> None:
    belief = unknown()
    for number, (measurement, travel, _) in enumerate(frames(ON_AXLE)):
        if number >= 90:  # from here on another geometry, which is consistent
            assert measurement.bearings is not None
            measurement = sight(
                Bearings(measurement.bearings.psi + 0.8, measurement.bearings.phi + 0.8)
            )
        before, belief = belief, learnt(belief, measurement, travel, missed=False)
        if number == 90:
            assert belief.contradictions == 5
            assert not belief.is_ranged
            assert before.is_ranged
        assert not belief.contradicts
    assert belief.contradictions == 0


def moving(psi: float, rho: float, mount: FloatArray, heading: float, travel: float) -> Extrinsics:
    """Return a belief that is about to move, with a covariance of full rank."""
    root = np.random.default_rng(1).standard_normal((5, 5))
    begun = told_extrinsics(mount, np.full(3, 0.1))
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
def test_the_covariance_moves_by_the_derivatives_of_the_mean(
    psi: float, rho: float, yaw: float, forward: float, heading: float, turn: float, travel: float
) -> None:
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


@given(poses(min_baseline=0.3), floats(-0.3, 0.3), floats(-0.3, 0.3), floats(-0.5, 0.5))
def test_moved_is_the_exact_path_of_the_camera(
    base: Pose, yaw: float, forward: float, travel: float
) -> None:
    mount = np.array([yaw, forward, 0.1])
    camera = camera_pose(base, mount)
    then = camera_pose(integrate(base, Twist(travel, 0.0), 1.0), mount)
    assume(min(camera.distance, then.distance) > 0.1)
    at_first = Bearings.from_pose(camera)
    belief = moving(
        at_first.psi,
        math.log(camera.distance),
        of_camera_axes(mount),
        at_first.heading_error,
        travel,
    )
    after = moved(belief, at_first.heading_error)
    assert after.distance == pytest.approx(then.distance, rel=1e-9)
    psi = Bearings.from_pose(then).psi
    assert wrap_angle(float(after.mean[PSI]) - psi) == pytest.approx(0.0, abs=1e-9)


@given(poses(min_baseline=0.3), floats(-0.3, 0.3), floats(0.1, 0.8))
def test_a_turn_in_place_swings_the_camera(base: Pose, yaw: float, turn: float) -> None:
    mount = np.array([yaw, 0.3, -0.1])
    camera = camera_pose(base, mount)
    then = camera_pose(integrate(base, Twist(0.0, turn), 1.0), mount)
    assume(min(camera.distance, then.distance) > 0.1)
    first, last = Bearings.from_pose(camera), Bearings.from_pose(then)
    belief = moving(
        first.psi, math.log(camera.distance), of_camera_axes(mount), first.heading_error, 0.0
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
def test_the_bearings_of_the_camera_give_those_of_the_axle(
    base: Pose, yaw: float, forward: float, left: float
) -> None:
    mount = np.array([yaw, forward, left])
    camera = camera_pose(base, mount)
    assume(camera.distance > 0.05)
    axle = at_axle(Bearings.from_pose(camera), of_camera_axes(mount), camera.distance)
    true = Bearings.from_pose(base)
    assert wrap_angle(axle.psi - true.psi) == pytest.approx(0.0, abs=1e-9)
    assert wrap_angle(axle.phi - true.phi) == pytest.approx(0.0, abs=1e-9)


def close_to_goal() -> Extrinsics:
    """Return a belief that knows the camera to be at 0.1 m, with a mount that is not known."""
    begun = placed(unknown(), Bearings.from_pose(Pose.from_start(0.0, -0.1, 0.0)), NOISE)
    mean, covariance = begun.mean.copy(), begun.covariance.copy()
    mean[RHO], covariance[RHO, RHO] = math.log(0.1), 0.01
    return replace(begun, mean=mean, covariance=covariance)


def test_near_the_goal_nothing_of_the_mount_is_learnt() -> None:
    belief = close_to_goal()
    told = belief.mean[YAW:].copy()
    for x in (0.02, -0.02, 0.03, 0.0, -0.03):
        bearings = Bearings.from_pose(Pose.from_start(x, -0.1, 100.0 * x))
        belief = learnt(belief, sight(bearings), 0.02, missed=True)
        assert belief.distance < NEAR
        np.testing.assert_array_equal(belief.mean[YAW:], told)
        assert not belief.believed
        assert belief.contradictions == 0


def test_an_uncertain_bearing_says_nothing_of_the_mount() -> None:
    belief = unknown()
    for measurement, travel, _ in frames(MOUNTS[0]):
        assert measurement.bearings is not None
        uncertain = sight(measurement.bearings, deviation=1.01 * UNCERTAIN)
        belief = learnt(belief, uncertain, travel, missed=True)
    np.testing.assert_array_equal(belief.mean[YAW:], ON_AXLE)


def test_what_is_not_seen_leaves_the_path_to_go_on() -> None:
    belief = unknown()
    for number, (measurement, travel, distance) in enumerate(frames(MOUNTS[0])):
        if 70 <= number < 80:
            measurement = replace(measurement, bearings=None, deviation=math.nan)
        belief = learnt(belief, measurement, travel, missed=False)
        assert not belief.is_ranged or belief.distance == pytest.approx(distance, rel=0.25)
    assert belief.contradictions == 0
    assert belief.is_ranged


def test_a_bearing_makes_no_deviation_larger() -> None:
    before = moving(-1.5, 1.0, np.array([0.0, 0.2, 0.0]), 0.0, 0.1)
    after, innovation = seen(before, -1.4, NOISE)
    assert innovation > 0.0
    assert (after.covariance.diagonal() <= before.covariance.diagonal()).all()
    assert after.mean[PSI] == pytest.approx(-1.4, abs=1e-3)
    assert after.mean[FORWARD] != before.mean[FORWARD]
