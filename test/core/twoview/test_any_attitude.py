"""Bearings of a camera mounted any way, from the first pair of views, without calibration."""

from dataclasses import replace
import math
import pickle

import cv2
import numpy as np
import pytest

from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.rays import image_points, rotation_level_camera
from visual_servo_epipolar.core.twoview.estimator import Attitude, Estimate, Prior
from visual_servo_epipolar.core.twoview.planar_motion import PHI, PSI
from visual_servo_epipolar.core.twoview.soft_planar import planar_parameters, soft_planar
from visual_servo_epipolar.evaluation.benchmarks.scenes import (
    Cell,
    draw_pair,
    draw_pairs,
    FOCAL,
    Pair,
)

GENERAL_PX = 1.5  # inlier threshold of the general geometry of OpenCV
LEVEL = Cell(baseline=3.0, points=60, noise=0.2, outliers=0.2, jitter=0.1)
WIDE = Attitude(tilt_deviation=math.radians(15.0), roll_deviation=math.radians(5.0))
COLD = Attitude(tilt_deviation=math.radians(2.0), roll_deviation=math.radians(2.0))
KNOWN = math.radians(0.1)
# The five-point geometry of OpenCV 4 is nearer to the truth.
OPENCV_5 = int(cv2.__version__.partition('.')[0]) >= 5
CORNERS = [(tilt, roll) for tilt in (-25.0, 25.0) for roll in (-8.0, 8.0)]


def solve(pair: Pair, prior: Prior) -> Estimate:
    rng = np.random.default_rng(0)
    return soft_planar(pair.current, pair.desired, noise=pair.noise, prior=prior, rng=rng)


def mounted(cell: Cell) -> Attitude:
    tilt, roll = math.radians(cell.tilt), math.radians(cell.roll)
    return Attitude(tilt, roll, tilt_deviation=KNOWN, roll_deviation=KNOWN)


def away(found: tuple[float, float], true: Bearings) -> float:
    """Return the larger error of the bearings in current and desired view, oriented [deg]."""
    expected = true.current, true.desired
    return math.degrees(
        max(abs(math.remainder(a - b, math.tau)) for a, b in zip(found, expected, strict=True))
    )


def own_error(pair: Pair, prior: Prior) -> float:
    """Return the error of the project's estimate [deg]."""
    bearings = solve(pair, prior).bearings
    return away((bearings.current, bearings.desired), pair.bearings)


def general_essential(pair: Pair) -> np.ndarray:
    """Return the essential matrix of OpenCV, shape (1, 3, 3)."""
    points = image_points(pair.current), image_points(pair.desired)
    essential, _ = cv2.findEssentialMat(
        *points, np.eye(3), cv2.USAC_MAGSAC, 0.999, GENERAL_PX / FOCAL
    )
    return np.asarray(essential[None, :3])


def general_error(pair: Pair, cell: Cell) -> float:
    """Return the error of OpenCV's geometry [deg] in a level camera, if its attitude is told."""
    points = image_points(pair.current), image_points(pair.desired)
    _, rotation, translation, _ = cv2.recoverPose(general_essential(pair)[0], *points, np.eye(3))
    level = rotation_level_camera(math.radians(cell.tilt), math.radians(cell.roll))
    centre, goal = level @ translation.ravel(), level @ -rotation.T @ translation.ravel()
    found = math.atan2(goal[0], goal[2]), math.atan2(centre[0], centre[2])
    return away(found, pair.bearings)


def axis_error(pair: Pair, found: np.ndarray) -> float:
    """Return the error of the angles ``found`` of axes, shape (2,), without orientation [deg]."""
    expected = pair.bearings.psi, pair.bearings.phi
    return math.degrees(
        max(abs(math.remainder(a - b, math.pi)) for a, b in zip(found, expected, strict=True))
    )


def drawn(count: int) -> list[tuple[Cell, Pair]]:
    """Return pairs of cameras of any tilt up to 25 and roll up to 8 degrees."""
    chosen = []
    for trial in range(count):
        rng = np.random.default_rng((5, trial))
        cell = replace(LEVEL, tilt=rng.uniform(-25.0, 25.0), roll=rng.uniform(-8.0, 8.0))
        chosen.append((cell, draw_pair(cell, rng)))
    return chosen


@pytest.mark.parametrize(('tilt', 'roll'), CORNERS)
def test_bearings_are_found_whichever_way_the_camera_is_mounted(tilt: float, roll: float) -> None:
    pairs = draw_pairs(replace(LEVEL, tilt=tilt, roll=roll), 25, seed=5)
    errors = [own_error(pair, Prior(WIDE)) for pair in pairs]
    # 0.5 to 1.0 / 3.8 deg: of the roll, what jitter hides stays open where the robot turns little.
    assert max(errors) < 5.0
    assert np.median(errors) < 1.5


def test_any_attitude_costs_little_and_bearings_beat_those_of_the_general_geometry() -> None:
    pairs = drawn(50)
    told = np.median([own_error(pair, Prior(mounted(cell))) for cell, pair in pairs])
    general = np.median([general_error(pair, cell) for cell, pair in pairs])
    # 0.06 against 0.35 with OpenCV 5 and 0.16 with 4.6, both told the true attitude
    assert told < 0.6 * general
    errors = [own_error(pair, Prior(WIDE)) for _, pair in pairs]
    own = np.median(errors)
    # 100 trials: 0.23 / 1.8 deg; 0.07 where the attitude is known.
    assert own < 0.5
    assert max(errors) < 5.0
    if OPENCV_5:
        assert own < general  # 0.28, although the five-point geometry alone is told
    # 1.07 and 0.89, if it is not
    assert own < 0.5 * np.median([general_error(pair, LEVEL) for _, pair in pairs])
    nearest = [
        axis_error(pair, planar_parameters(general_essential(pair), WIDE)[0, [PSI, PHI]])
        for _, pair in pairs
    ]
    # 0.44, with OpenCV 4.6 0.36
    assert own < (0.75 if OPENCV_5 else 0.9) * np.median(nearest)


@pytest.mark.parametrize(('tilt', 'roll'), [(0.0, 0.0), (1.0, -0.5)])
def test_a_camera_nearly_level_is_seen_as_if_that_were_known(tilt: float, roll: float) -> None:
    for pair in draw_pairs(replace(LEVEL, tilt=tilt, roll=roll), 12, seed=6):
        wide, cold = solve(pair, Prior(WIDE)), solve(pair, Prior(COLD))
        assert pickle.dumps(wide) == pickle.dumps(cold)


@pytest.mark.parametrize('mount', [WIDE, None])
def test_what_was_learnt_wrongly_is_given_up_for_the_mount_alone(mount) -> None:
    wrong = Prior(Attitude(tilt_deviation=KNOWN, roll_deviation=KNOWN), mount=mount)
    for pair in draw_pairs(replace(LEVEL, tilt=15.0), 12, seed=5):
        try:
            found = solve(pair, wrong)
        except DegenerateGeometryError:
            assert mount is None
            continue
        assert found.attitude is not None
        tilt = math.degrees(found.attitude.tilt)
        if mount is None:
            assert found.inliers.mean() < 0.3
            assert abs(tilt) < 1.0
        else:
            assert away((found.bearings.current, found.bearings.desired), pair.bearings) < 2.0
            assert tilt == pytest.approx(15.0, abs=1.5)


def test_what_was_learnt_right_is_kept_for_a_mount_of_any_attitude() -> None:
    tilted = math.radians(15.0)
    known = Attitude(tilt=tilted, tilt_deviation=KNOWN, roll_deviation=KNOWN)
    for pair in draw_pairs(replace(LEVEL, tilt=15.0), 12, seed=5):
        with_mount, without = solve(pair, Prior(known, mount=WIDE)), solve(pair, Prior(known))
        assert with_mount.bearings == without.bearings
        assert with_mount.attitude == without.attitude


@pytest.mark.parametrize('prior', [Prior(WIDE), Prior(COLD)], ids=['wide', 'cold'])
def test_matches_that_coincide_are_degenerate(prior: Prior) -> None:
    pair = draw_pairs(LEVEL, 1, seed=7)[0]
    for chosen in (np.zeros(30, dtype=int), np.arange(30) % 2 + 20):
        current, desired = pair.current[chosen], pair.desired[chosen]
        same = replace(pair, current=current, desired=desired, noise=pair.noise[chosen])
        with pytest.raises(DegenerateGeometryError):
            solve(same, prior)


def test_a_view_that_tilts_by_a_degree_against_the_photograph_is_seen_by_another_attempt() -> None:
    cell = Cell(baseline=2.0, points=40, noise=0.3, outliers=0.2, jitter=1.0, tilt=1.0)
    rough, deviation = math.radians(cell.jitter), math.radians(1.5)
    prior = Prior(Attitude(tilt_deviation=deviation, roll_deviation=deviation, jitter=rough))
    pairs = [draw_pair(cell, np.random.default_rng(seed)) for seed in range(2, 32)]
    assert max(own_error(pair, prior) for pair in pairs) < 3.0  # 44, without hypotheses of jumps
