"""Step 2: D, its map and proposition 2; and the smooth law, one motion to the goal."""

import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from strategies import floats, seen_from
import theory_bounds as theory

from visual_servo_epipolar.core.geometry.motion import arc, Pose
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.laws.braking import rate_within
from visual_servo_epipolar.core.laws.steering import (
    aim,
    curvature,
    Gains,
    polar_pose,
    PolarPose,
    visible_aim,
)
from visual_servo_epipolar.core.twoview.measurement import feature_difference

FEATURES = st.lists(
    st.tuples(floats(-2.0, 2.0), floats(-1.5, 1.5), floats(3.0, 8.0)), min_size=1, max_size=8
).filter(lambda rows: all(math.hypot(x, y) > 0.05 for x, y, _ in rows))
BEHIND = st.one_of(floats(-1.5, -0.01), floats(0.01, 6.0))


def difference(points: np.ndarray, behind: float) -> float:
    """Return D through the camera, for a robot ``behind`` [m] the goal on its axis."""
    seen = seen_from(Pose(0.0, -behind, math.pi / 2.0), points)
    return feature_difference(normalised(seen), normalised(points))


def slope(points: np.ndarray, behind: float) -> float:
    slopes = [theory.matching_slope(math.hypot(x, y), z, behind) for x, y, z in points]
    return float(np.mean(slopes))


@given(FEATURES, BEHIND)
def test_23_is_what_the_camera_sees(rows: list[tuple[float, float, float]], behind: float) -> None:
    points = np.array(rows)
    found = difference(points, behind)
    # Differences of squares that are nearly equal lose digits.
    assert found == pytest.approx(-slope(points, behind) * behind, rel=1e-7, abs=1e-13)
    assert slope(points, behind) > 0.0


@settings(max_examples=30)
@given(FEATURES, BEHIND, floats(0.5, 20.0))
def test_proposition_2_the_lyapunov_function_falls_at_the_least_slope(rows, behind, k_t) -> None:
    points = np.array(rows)
    # The least slope on the way: it falls with depth, so it is at one of the two ends.
    least = min(slope(points, behind), slope(points, 0.0))
    duration = 3.0 / (k_t * least)

    def rate(_: float, y: np.ndarray) -> list[float]:
        return [equations.match_features(difference(points, -float(y[0])), k_t=k_t).linear]

    times = np.linspace(0.0, duration, 20)
    found = solve_ivp(rate, (0.0, duration), [-behind], 'LSODA', times, rtol=1e-9, atol=1e-12)
    assert found.success
    y = found.y[0]
    lyapunov = 0.5 * y**2
    # V' = -alpha k_t d^2 (the paper), along the run.
    for position, value in zip(y, lyapunov, strict=True):
        u1 = rate(0.0, np.array([position]))[0]
        expected = -slope(points, -position) * k_t * 2.0 * value
        assert position * u1 == pytest.approx(expected, rel=1e-6, abs=1e-14)
    assert (np.diff(lyapunov) < 0.0).all()
    assert (np.abs(y) <= abs(behind) * np.exp(-k_t * least * times) * (1.0 + 1e-6)).all()


@given(FEATURES, st.lists(BEHIND, min_size=2, max_size=2, unique=True))
def test_the_map_is_monotonic_for_any_number_of_features(rows, pair) -> None:
    points = np.array(rows)
    near, far = sorted(pair)
    if far - near > 1e-6:
        assert difference(points, far) < difference(points, near)


GAINS = Gains()
STEP = 2e-3  # of the way, in distances
STARTS = [(1.5, -2.0, -0.26), (-1.5, -2.5, 0.2), (0.3, -5.0, 0.26), (-1.0, -3.0, 0.0)]

angles = st.floats(-1.2, 1.2)


def driven(
    x: float, y: float, heading: float, *, ratio: float = 1.0, lens: float = 1.0, end: float = 1e-3
) -> list[PolarPose]:
    """Return the poses on the way, of d_hat / d = ``ratio`` and f_hat / f = ``lens``."""
    poses = [polar_pose(x, y, heading)]
    while poses[-1].distance > end * poses[0].distance and len(poses) < 20_000:
        distance, delta, phi = poses[-1]
        seen = PolarPose(ratio * distance, seen_bearing(delta, lens), seen_bearing(phi, lens))
        step = STEP * distance
        x, y, theta = arc(x, y, heading + 0.5 * math.pi, 1.0, curvature(seen, GAINS), step)
        heading = theta - 0.5 * math.pi
        poses.append(polar_pose(x, y, heading))
    return poses


def seen_bearing(angle: float, lens: float) -> float:
    """Return a bearing as the lens of another focal length shows it."""
    return math.atan2(math.sin(angle), lens * math.cos(angle))


@pytest.mark.parametrize('start', STARTS)
@pytest.mark.parametrize('ratio', [0.3, 0.5, 1.0, 2.0, 3.0])
def test_bearings_and_distance_vanish_for_a_constant_error_of_the_distance(start, ratio) -> None:
    end = driven(*start, ratio=ratio, end=1e-4)[-1]
    assert end.distance < 2e-4 * math.hypot(*start[:2])
    assert max(abs(end.delta), abs(end.phi)) < 0.02


@given(delta=angles, phi=angles, distance=st.floats(0.3, 8.0))
def test_the_heading_off_its_aim_falls_by_the_gain(delta, phi, distance) -> None:
    # z = delta - aim(phi): z' = -(v / d) k2 z, exactly.
    pose, h = PolarPose(distance, delta, phi), 1e-6
    turn, sight = curvature(pose, GAINS), math.sin(delta) / distance
    after = delta + h * (turn + sight) - aim(phi + h * sight, GAINS)
    rate = (after - (delta - aim(phi, GAINS))) / h
    expected = -GAINS.k2 * (delta - aim(phi, GAINS)) / distance
    assert rate == pytest.approx(expected, abs=1e-3 / distance)


@pytest.mark.parametrize('start', STARTS)
def test_angles_stay_below_their_bounds(start: tuple[float, float, float]) -> None:
    poses = driven(*start)
    first = poses[0]
    off = abs(first.delta - aim(first.phi, GAINS))
    most_phi = abs(first.phi) + off / GAINS.k2
    most_delta = off + math.atan(GAINS.k1 * most_phi)
    assert max(abs(pose.phi) for pose in poses) <= most_phi + 0.01
    assert max(abs(pose.delta) for pose in poses) <= most_delta + 0.01


@pytest.mark.parametrize('start', STARTS)
@pytest.mark.parametrize('lens', [0.5, 0.7, 1.4, 2.0])
def test_a_wrong_focal_length_is_as_a_wrong_distance(start, lens) -> None:
    end = driven(*start, lens=lens, end=1e-4)[-1]
    assert max(abs(end.delta), abs(end.phi)) < 0.02
    pose = PolarPose(1.0, 1e-4, -3e-4)
    seen = PolarPose(1.0, *(seen_bearing(angle, lens) for angle in pose[1:]))
    farther = curvature(PolarPose(lens, *pose[1:]), GAINS)
    assert curvature(seen, GAINS) == pytest.approx(farther, rel=1e-3)


@pytest.mark.parametrize('start', [(1.0, -2.5, -0.2), *STARTS[2:]])
def test_features_stay_in_view_and_the_way_ends_at_the_goal(start) -> None:
    # As if features left the view 0.6 rad off the heading of the goal.
    x, y, heading = start
    least = most = heading
    for _ in range(8000):
        pose = polar_pose(x, y, heading)
        margins = 0.6 - heading, 0.6 + heading
        held = visible_aim(aim(pose.phi, GAINS), pose.delta, margins)
        kappa = curvature(pose, GAINS, delta_held=held)
        x, y, theta = arc(x, y, heading + 0.5 * math.pi, 1.0, kappa, STEP * pose.distance)
        heading = theta - 0.5 * math.pi
        least, most = min(least, heading), max(most, heading)
    assert -0.61 < least <= most < 0.61
    assert math.hypot(x, y) < 1e-3


def test_noise_of_the_bearings_leaves_an_offset_that_falls_with_the_distance() -> None:
    # White noise of the bearings: the offset at d is a small multiple of noise times d.
    rng, noise = np.random.default_rng(1), math.radians(0.3)
    offsets = []
    for _ in range(20):
        x, y, heading = 0.8, -3.0, 0.1
        while y < -0.1:
            pose = polar_pose(x, y, heading)
            error = noise * rng.standard_normal(2)
            seen = PolarPose(pose.distance, pose.delta + error[0], pose.phi + error[1])
            kappa = curvature(seen, GAINS)
            x, y, theta = arc(x, y, heading + 0.5 * math.pi, 1.0, kappa, 0.02 * pose.distance)
            heading = theta - 0.5 * math.pi
        offsets.append(x)
    assert np.std(offsets) < 0.5 * noise * 0.1


@given(margin=st.floats(1e-4, 3.0), delay=st.floats(0.05, 0.6), braking=st.floats(0.1, 2.0))
def test_a_rate_stops_at_its_bound(margin: float, delay: float, braking: float) -> None:
    rate = rate_within(margin, deceleration=braking, delay=delay)
    assert rate * delay + 0.5 * rate * rate / braking == pytest.approx(margin)
    assert rate_within(-margin, deceleration=braking, delay=delay) == -rate


@pytest.mark.parametrize('gap', [0.03, 0.01, 0.0])
def test_nothing_is_infinite_at_the_goal(gap: float) -> None:
    pose = polar_pose(0.0, -gap, 0.01, ahead=0.08)
    assert abs(curvature(pose, GAINS)) < 2.0
