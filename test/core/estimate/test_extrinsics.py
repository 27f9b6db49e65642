"""The camera's place on the base, learnt: from drives by exact kinematics, without images."""

from collections.abc import Iterator
from dataclasses import replace
import math

from hypothesis import assume, given
from mounted import camera_pose, frames, NOISE, of_camera_axes, sight
import numpy as np
import pytest
from strategies import angles, floats, poses

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimate.extrinsics import (
    configured_extrinsics,
    Extrinsics,
    FAULT,
    is_significant,
    LEAST_STEP,
    moved,
    NEAR,
    placed,
    PSI,
    ranged,
    RHO,
    UNCERTAIN,
    update_extrinsics,
    YAW,
)
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, Twist, wrap_angle
from visual_servo_epipolar.core.rigs.fixed_mount import at_axle
from visual_servo_epipolar.core.servo.settings import ServoSettings

ON_AXLE = np.zeros(3)
JUMP = 110  # number of an image, when the distance is known
MOUNTS = [
    np.array([math.radians(5.0), 0.25, 0.0]),
    np.array([math.radians(-4.0), -0.2, 0.0]),
    np.array([math.radians(3.0), 0.3, 0.05]),
]


def unknown(told: FloatArray = ON_AXLE, **known: float) -> Extrinsics:
    """Return what settings know of a mount that is ``told``."""
    mount = dict(zip(('yaw', 'forward', 'left'), told.tolist(), strict=True))
    mount = {f'camera_{name}': value for name, value in {**mount, **known}.items()}
    return ServoSettings(**mount).extrinsics


def beliefs(
    mount: FloatArray, belief: Extrinsics, *, missed: bool = False, seed: int = 0
) -> Iterator[tuple[Extrinsics, float]]:
    """Yield the belief after each image of DRIVE, and the true distance [m]."""
    for measurement, travel, distance in frames(mount, seed=seed):
        belief = update_extrinsics(belief, measurement, travel, missed=missed)
        yield belief, distance


@pytest.mark.parametrize('seed', range(4))
@pytest.mark.parametrize('mount', MOUNTS)
def test_a_drive_tells_the_mount_and_the_distance(mount: FloatArray, seed: int) -> None:
    *_, (belief, distance) = beliefs(mount, unknown(), seed=seed)
    assert belief.believed
    assert belief.mount[0] == pytest.approx(mount[0], abs=math.radians(1.0))
    # Two views may turn wrong by what a lens is told wrong: of a lever arm a part stays unlearnt.
    assert belief.mount[1] == pytest.approx(mount[1], abs=0.055)
    assert belief.is_ranged
    assert belief.distance == pytest.approx(distance, rel=0.1)


@pytest.mark.parametrize('missed', [False, True])
@pytest.mark.parametrize('seed', range(6))
def test_a_camera_on_the_axle_is_left_there(seed: int, missed: bool) -> None:
    learning = list(beliefs(ON_AXLE, unknown(), missed=missed, seed=seed))
    assert not any(belief.believed for belief, _ in learning)
    np.testing.assert_array_equal(learning[-1][0].mount, ON_AXLE)


@pytest.mark.parametrize('mount', [ON_AXLE, *MOUNTS])
def test_a_mount_that_is_told_right_is_left_and_none_contradicts_commands(mount) -> None:
    *_, (belief, _) = beliefs(mount, unknown(mount))
    assert not belief.believed
    np.testing.assert_allclose(belief.mount, of_camera_axes(mount))
    assert {belief.contradictions for belief, _ in beliefs(mount, unknown())} == {0}


def test_one_jump_is_forgiven_and_the_path_begins_anew() -> None:
    belief = unknown()
    for number, (measurement, travel, _) in enumerate(frames(ON_AXLE)):
        if number >= JUMP:  # from here on another geometry, which is consistent
            assert measurement.bearings is not None
            psi, phi = measurement.bearings.psi + 0.8, measurement.bearings.phi + 0.8
            measurement = sight(Bearings(psi, phi))
        before, belief = belief, update_extrinsics(belief, measurement, travel, missed=False)
        if number == JUMP:
            assert belief.contradictions == 5
            assert not belief.is_ranged
            assert before.is_ranged
        assert not belief.contradicts
    assert belief.contradictions == 0


def close_to_goal(distance: float = 0.1) -> Extrinsics:
    """Return a belief that knows the camera to be so near [m], with a mount that is not known."""
    begun = placed(unknown(), Bearings.from_pose(Pose.from_start(0.0, -1.0, 0.0)), NOISE)
    mean, covariance = begun.mean.copy(), begun.covariance.copy()
    mean[RHO], covariance[RHO, RHO] = math.log(distance), 0.01
    return replace(begun, mean=mean, covariance=covariance)


def test_near_the_goal_nothing_of_the_mount_is_learnt() -> None:
    belief = close_to_goal()
    told = belief.mean[YAW:].copy()
    for x in (0.02, -0.02, 0.03, 0.0, -0.03):
        bearings = Bearings.from_pose(Pose.from_start(x, -0.1, 100.0 * x))
        belief = update_extrinsics(belief, sight(bearings), 0.02, missed=True)
        assert belief.distance < NEAR
        np.testing.assert_array_equal(belief.mean[YAW:], told)
        assert not belief.believed
        assert belief.contradictions == 0


def test_close_by_the_goal_a_direction_tells_nothing_of_the_mount() -> None:
    """A base that is centimetres behind its commands has passed it elsewhere than thought."""
    here, there = (Pose.from_start(x, y, 0.0) for x, y in ((0.0, -0.03), (-0.03, -0.15)))
    before = replace(close_to_goal(0.03), travel=-LEAST_STEP)
    near = update_extrinsics(before, sight(Bearings.from_pose(here)), 0.0, missed=False)
    seen_aside = sight(Bearings.from_pose(there))
    after = update_extrinsics(replace(near, travel=-0.12), seen_aside, 0.0, missed=False)
    assert after.contradictions == 0
    deviation = math.sqrt(after.covariance[YAW, YAW])
    assert abs(after.mean[YAW]) < 1.5 * deviation


def test_what_a_lens_turns_wrong_is_no_lever_arm() -> None:
    """Through a focal length told 5 % wrong a turn on the spot looks like a small way aside."""
    belief, goal_ahead = unknown(), Bearings(-1.2, -0.3)
    for number in range(400):
        turn = 0.8 * math.sin(math.tau * number / 100.0)  # to and fro, as in attempts
        wrong = 0.03 * turn
        seen_there = Bearings(goal_ahead.psi + wrong, goal_ahead.phi - turn + wrong)
        belief = update_extrinsics(belief, sight(seen_there), 0.0, missed=False)
    assert not belief.believed
    off = np.abs(belief.mean[YAW:] - ON_AXLE)
    assert (off <= 2.0 * np.sqrt(belief.covariance.diagonal()[YAW:])).all()


def test_from_two_views_to_a_memory_the_robot_has_not_moved() -> None:
    """They differ by what two views do not know of the lens; nothing of the mount is in that."""
    belief = list(beliefs(ON_AXLE, unknown()))[JUMP][0]
    measurement, travel, _ = list(frames(ON_AXLE))[JUMP + 1]
    assert measurement.bearings is not None
    psi, phi = measurement.bearings.psi + 0.02, measurement.bearings.phi + 0.02
    remembered = replace(
        sight(Bearings(psi, phi)),
        offset=(belief.distance * math.cos(psi), belief.distance * math.sin(psi)),
        offset_deviation=0.05 * belief.distance,
        remembered=True,
    )
    belief = replace(belief, travel=-2.0 * LEAST_STEP)
    after = update_extrinsics(belief, remembered, travel, missed=False)
    assert after.remembers
    assert after.mean[0] == psi
    again = update_extrinsics(replace(belief, remembers=True), remembered, travel, missed=False)
    changes = [np.abs(each.mean[YAW:] - belief.mean[YAW:]).max() for each in (after, again)]
    assert changes[0] < 0.2 * changes[1]
    # Half a radian is no lens: what was driven contradicts it, whoever says it.
    leapt = replace(remembered, bearings=Bearings(psi + 0.5, phi + 0.5))
    assert update_extrinsics(belief, leapt, travel, missed=False).contradictions == FAULT
    # A memory that knows the place may know the bearing less well than two views do.
    theirs = update_extrinsics(belief, replace(remembered, remembered=False), travel, missed=False)
    assert not theirs.remembers


@pytest.mark.parametrize('aside', [0.15, 0.2, 0.25, 0.3, 0.5])
@pytest.mark.parametrize('step', [0.02, 0.03])
def test_a_goal_far_nearer_than_thought_makes_no_false_certainty(aside, step) -> None:
    """Of bearings alone, backing off past it on an arc: of which a mount was made, of 13 deg."""
    base, belief, travel = Pose.from_start(aside, -0.01, -9.0), unknown(), 0.0
    for _ in range(12):
        exact = sight(Bearings.from_pose(base), deviation=0.0045)
        belief = update_extrinsics(belief, exact, travel, missed=False)
        off = abs(belief.mean[RHO] - math.log(base.distance))
        assert off <= 3.0 * math.sqrt(belief.covariance[RHO, RHO])
        base, travel = integrate(base, Twist(-step / 0.09, -0.15), 0.09), -step
    assert belief.distance == pytest.approx(base.distance, rel=0.1)


def test_views_of_one_memory_tell_the_distance_once() -> None:
    first = ranged(unknown(), 2.0, 0.4)
    again = first
    for _ in range(20):
        again = ranged(again, 2.0, 0.4)
    known = math.sqrt(again.covariance[RHO, RHO])
    assert known == pytest.approx(0.2)
    assert again.distance == pytest.approx(2.0, rel=0.02)


def test_a_distance_that_a_memory_contradicts_is_dropped_and_no_mount_is_made_of_it() -> None:
    begun = close_to_goal()
    moved_on = begun.covariance + 0.002 * np.ones((5, 5))  # where the mount hangs on the distance
    after = ranged(replace(begun, covariance=moved_on), 1.0, 0.1)
    np.testing.assert_array_equal(after.mean[YAW:], begun.mean[YAW:])
    assert after.distance == pytest.approx(1.0)


@pytest.mark.parametrize(
    'doubtful',
    [
        lambda it: sight(it.bearings, deviation=1.01 * UNCERTAIN),
        lambda it: replace(it, rivals=(it.bearings, it.bearings.reversed())),
    ],
    ids=['an uncertain bearing', 'two geometries that fit'],
)
def test_what_is_in_doubt_says_nothing_of_the_mount(doubtful) -> None:
    belief = unknown()
    for measurement, travel, _ in frames(MOUNTS[0]):
        belief = update_extrinsics(belief, doubtful(measurement), travel, missed=True)
    np.testing.assert_array_equal(belief.mean[YAW:], ON_AXLE)


@pytest.mark.parametrize('missed', [False, True])
def test_once_two_geometries_have_fitted_a_mount_is_believed_after_a_miss_alone(missed) -> None:
    belief, (first, *later) = unknown(), frames(MOUNTS[0])
    ambiguous = replace(first[0], rivals=(first[0].bearings, first[0].bearings.reversed()))
    for measurement, travel, _ in [(ambiguous, *first[1:]), *later]:
        belief = update_extrinsics(belief, measurement, travel, missed=missed)
    assert belief.believed is missed
    assert belief.mean[YAW] == pytest.approx(MOUNTS[0][0], abs=math.radians(1.0))


def test_what_is_not_seen_leaves_the_path_to_go_on() -> None:
    belief = unknown()
    for number, (measurement, travel, distance) in enumerate(frames(MOUNTS[0])):
        if 70 <= number < 80:
            measurement = replace(measurement, bearings=None, deviation=math.nan)
        belief = update_extrinsics(belief, measurement, travel, missed=False)
        assert not belief.is_ranged or belief.distance == pytest.approx(distance, rel=0.25)
    assert belief.contradictions == 0
    assert belief.is_ranged


@pytest.mark.parametrize(
    ('yaw', 'deviation', 'log_distance', 'believed'),
    [
        (4.1, 1.0, 0.24, (True, True)),
        (-4.1, 1.0, 0.24, (True, True)),
        (3.9, 1.0, 0.24, (False, True)),
        (3.4, 1.0, 0.24, (False, False)),
        (1.9, 0.1, 0.24, (False, False)),  # too little to matter
        (4.1, 1.0, 0.26, (False, True)),
        (4.1, 1.0, 0.51, (False, False)),  # the distance is not known: nor is the rest
    ],
)
def test_what_is_believed_is_certain_and_matters(yaw, deviation, log_distance, believed) -> None:
    begun = unknown()
    mean, covariance = begun.mean.copy(), begun.covariance.copy()
    mean[YAW], covariance[YAW, YAW] = math.radians(yaw), math.radians(deviation) ** 2
    covariance[RHO, RHO] = log_distance**2
    belief = replace(begun, mean=mean, covariance=covariance)
    assert tuple(is_significant(belief, missed) for missed in (False, True)) == believed


def test_an_offset_aside_alone_is_not_believed() -> None:
    begun = unknown()
    mean = begun.mean + [0.0, 0.0, 0.0, 0.0, 0.5]
    certain = replace(begun, mean=mean, covariance=1e-6 * np.eye(5))
    assert not is_significant(certain, True)
    ahead = replace(certain, mean=begun.mean + [0.0, 0.0, 0.0, 0.11, 0.0])
    assert is_significant(ahead, False)


@pytest.mark.parametrize('at_fault', [YAW, YAW + 1, YAW + 2])
@pytest.mark.parametrize(('deviations', 'kept'), [(4.9, True), (5.1, False)])
def test_a_mount_that_cannot_be_is_forgotten_and_learnt_anew(at_fault, deviations, kept) -> None:
    measurement, travel, _ = next(frames(ON_AXLE))
    before = placed(unknown(), measurement.bearings, 0.01)
    mean = before.mean.copy()
    mean[at_fault] = deviations * before.deviations[at_fault - YAW]
    before = replace(before, mean=mean, believed=True, travel=LEAST_STEP, contradictions=3)
    after = update_extrinsics(before, measurement, travel, missed=False)
    assert after.believed == kept
    if not kept:
        np.testing.assert_array_equal(after.mount, ON_AXLE)
        assert (after.placed, after.contradictions) == (True, 3 + FAULT)


def moving(psi: float, rho: float, mount: FloatArray, heading: float, travel: float) -> Extrinsics:
    """Return a belief that is about to move, with a covariance of full rank."""
    root = np.random.default_rng(1).standard_normal((5, 5))
    begun = configured_extrinsics(mount, np.full(3, 0.1))
    mean, path = np.array([psi, rho, *mount]), {'heading': heading, 'travel': travel}
    return replace(begun, mean=mean, covariance=root @ root.T, placed=True, **path)


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
    axes, rho = of_camera_axes(mount), math.log(camera.distance)
    belief = moving(first.psi, rho, axes, first.heading_error, twist.linear)
    after = moved(belief, last.heading_error)
    assert after.distance == pytest.approx(then.distance, rel=1e-9)
    assert wrap_angle(float(after.mean[PSI]) - last.psi) == pytest.approx(0.0, abs=1e-9)


@given(poses(min_baseline=0.3), floats(-1.0, 1.0), floats(-0.5, 0.5), floats(-0.5, 0.5))
def test_the_bearings_of_the_camera_give_those_of_the_axle(base, yaw, forward, left) -> None:
    mount = np.array([yaw, forward, left])
    camera = camera_pose(base, mount)
    assume(camera.distance > 0.05)
    axle = at_axle(Bearings.from_pose(camera), of_camera_axes(mount), camera.distance)
    true = Bearings.from_pose(base)
    assert wrap_angle(axle.psi - true.psi) == pytest.approx(0.0, abs=1e-9)
    assert wrap_angle(axle.phi - true.phi) == pytest.approx(0.0, abs=1e-9)
