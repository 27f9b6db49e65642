"""One motion (law ``smooth``): convergence for a wrong distance or lens, bounds of its angles."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.motion import arc
from visual_servo_epipolar.core.laws.braking import rate_within
from visual_servo_epipolar.core.laws.steering import (
    aim,
    curvature,
    Gains,
    polar_pose,
    PolarPose,
    visible_aim,
)

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


@pytest.mark.parametrize('ratio', [0.2, 0.7, 1.0, 3.0, 6.9, 7.1, 9.0])
def test_the_interval_of_the_ratio_ends_at_one_plus_both_gains(ratio: float) -> None:
    # d phi / d s = tan(delta), d delta / d s with s = ln(d_0 / d), at the origin.
    gain = GAINS.k1 * GAINS.k2 / ratio
    damping = (1.0 + GAINS.k1 + GAINS.k2) / ratio - 1.0
    decays = np.roots([1.0, damping, gain]).real.max() < 0.0
    assert decays == (ratio < 1.0 + GAINS.k1 + GAINS.k2)


@given(delta=angles, phi=angles, distance=st.floats(0.3, 8.0))
def test_the_heading_off_its_aim_falls_by_the_gain(delta, phi, distance) -> None:
    # z = delta - aim(phi): z' = -(v / d) k2 z, exactly.
    pose, h = PolarPose(distance, delta, phi), 1e-6
    turn, sight = curvature(pose, GAINS), math.sin(delta) / distance
    after = delta + h * (turn + sight) - aim(phi + h * sight, GAINS)
    rate = (after - (delta - aim(phi, GAINS))) / h
    assert rate == pytest.approx(
        -GAINS.k2 * (delta - aim(phi, GAINS)) / distance, abs=1e-3 / distance
    )


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
