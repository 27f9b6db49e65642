"""The place near the goal: averaged over views, as far as the robot obeys and nobody pushes it."""

from dataclasses import replace
import math

import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimate.map_state import (
    filter_pose,
    first_pose,
    SLIP,
    with_heading_noise,
)
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.core.odometry.increments import Motion

OWN = np.diag([0.8e-3, 0.5e-3, 1.5e-4, 1e-3, 1e-3]) ** 2
COMMON = np.diag([0.4e-3, 0.3e-3, 0.5e-4, 1e-3, 1e-3]) ** 2
STILL = Motion()


def said(pose: FloatArray) -> MapLocalization:
    return MapLocalization(
        np.array([*pose, 0.0, 0.0]), OWN + COMMON, OWN, None, np.ones(0, bool), np.zeros(5)
    )


def noisy(place: FloatArray, rng: np.random.Generator) -> MapLocalization:
    return said(place + rng.normal(size=3) * np.sqrt(np.diag(OWN)[:3]))


@pytest.mark.parametrize('noise', [0.0, 3e-3])  # of a head's encoder [rad]
def test_views_of_a_robot_that_stands_average_out(noise: float) -> None:
    rng, true, count = np.random.default_rng(1), np.array([0.001, -0.002, 0.0005]), 16
    errors, now, encoder = [], said(true), np.random.default_rng(3)
    for _ in range(200):
        place = None
        for _ in range(count):
            view = noisy(true + [0.0, 0.0, noise * encoder.normal()], rng)
            now, place = filter_pose(with_heading_noise(view, noise), place, STILL)
        errors.append(now.pose[:3] - true)
    expected = np.sqrt((np.diag(OWN)[:3] + [0.0, 0.0, noise**2]) / count)
    assert np.std(errors, axis=0) == pytest.approx(expected, rel=0.25)
    assert np.sqrt(np.diag(now.own)[:3]) == pytest.approx(expected, rel=0.05)
    # What all views have in common stays.
    assert now.covariance - now.own == pytest.approx(COMMON, abs=1e-12)


@pytest.mark.parametrize(
    ('motion', 'heading', 'step'),
    [
        (Motion(way=0.01), 0.0, (0.0, 0.01, 0.0)),
        (Motion(way=0.01), 0.5 * math.pi, (-0.01, 0.0, 0.0)),
        (Motion(turn=0.02), 0.0, (0.0, 0.0, 0.02)),
    ],
)
def test_a_place_moves_as_the_robot(motion, heading, step) -> None:
    before = first_pose(np.array([0.1, 0.2, heading]), OWN[:3, :3], STILL)
    after = before.after(motion)
    assert (after.mean - before.mean)[:3] == pytest.approx(step, abs=1e-12)
    assert (np.diag(after.covariance) >= np.diag(before.covariance)).all()
    assert after.covariance.trace() > before.covariance.trace()


def test_what_the_shrinkage_shifts_shifts_the_views_before_as_well() -> None:
    place, shift = None, np.array([0.002, -0.001, 0.0003, 0.0, 0.0])
    for _ in range(20):
        now, place = filter_pose(said(np.zeros(3)), place, STILL)
    assert now.pose[:3] == pytest.approx(np.zeros(3))
    moved = said(shift[:3])
    now, place = filter_pose(replace(moved, shift=shift), place, STILL)
    assert now.pose[:3] == pytest.approx(shift[:3])


def test_a_robot_that_drives_fast_is_where_it_is_seen() -> None:
    first = np.array([0.0, -0.5, 0.0])
    _, place = filter_pose(said(first), None, STILL)
    seen = first + [0.0003, 0.019, 0.0001]
    now, _ = filter_pose(said(seen), place, Motion(way=0.02, turn=0.01))
    assert now.pose[:3] == pytest.approx(seen, abs=1.5e-4)


@pytest.mark.parametrize('slip', [0.0, 0.04, -0.04])
def test_a_way_to_the_side_that_lasts_is_learnt_and_views_average_on_the_way(slip: float) -> None:
    """As a camera looks elsewhere than where the base drives: the line to the goal is no saw."""
    rng, step, errors, slips = np.random.default_rng(2), 0.03, [], []
    for _ in range(40):
        true, place, motion = np.array([0.0, -1.2, 0.0]), None, STILL
        for _ in range(30):
            now, place = filter_pose(noisy(true, rng), place, motion)
            motion, last = Motion(way=step), true
            true = true + [slip * step, step, 0.0]
        assert place is not None
        errors.append(now.pose[0] - last[0])
        slips.append(place.mean[SLIP])
    assert np.std(errors) < 0.45e-3  # 0.8 mm by one view
    assert abs(np.mean(errors)) < 0.3e-3
    assert np.mean(slips) == pytest.approx(slip, abs=0.005)


@pytest.mark.parametrize(
    ('begin', 'told', 'rolls'),
    [
        # Commands count as they were sent; where they act at once, it drives less far by each.
        (0.0, [0.02 * 0.7**k for k in range(15)], [0.02 * 0.7**k for k in range(15)]),
        (0.01, [0.0] * 6, [0.006, 0.004, 0.002, 0.001, 0.0, 0.0]),  # it rolls on, late
    ],
    ids=['it slows down', 'it obeys late'],
)
def test_a_base_that_slows_down_or_obeys_late_leaves_no_error(begin, told, rolls) -> None:
    true = np.array([0.0, -0.05, 0.0])
    now, place = filter_pose(said(true), None, Motion(way=begin))
    for way, roll in zip(told, rolls, strict=True):
        true = true + [0.0, roll, 0.0]
        now, place = filter_pose(said(true), place, Motion(way=way))
    assert abs(now.pose[1] - true[1]) < 0.3e-3


def test_who_is_pushed_begins_anew() -> None:
    _, place = filter_pose(said(np.zeros(3)), None, STILL)
    away = np.array([0.05, -0.1, 0.02])
    now, place = filter_pose(said(away), place, STILL)
    assert now.pose[:3] == pytest.approx(away)
    assert now.own == pytest.approx(OWN)
    assert place is not None and place.mean[:3] == pytest.approx(away)


def test_wheels_are_a_random_walk_and_do_not_come_late() -> None:
    step, before = (
        Motion(0.01, 0.0, measured=True),
        first_pose(np.zeros(3), np.zeros((3, 3)), STILL),
    )
    after = before.after(step)
    ahead = 0.0075**2 * 0.01 + (0.05 * 0.01) ** 2
    assert after.covariance[1, 1] == pytest.approx(ahead)
    stands = Motion(measured=True)
    assert after.after(stands).covariance == pytest.approx(after.covariance)
