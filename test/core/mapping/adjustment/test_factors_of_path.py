"""Path factors: their derivatives are those of their residuals, and exact drives are met."""

from dataclasses import replace
import math

from docking_drives import Drive
import numpy as np
import pytest

from visual_servo_epipolar.core.docking.key_views import factors_along, window_of
from visual_servo_epipolar.core.docking.search import FIRST_DISTANCES
from visual_servo_epipolar.core.docking.settings import DockPoseSettings
from visual_servo_epipolar.core.geometry.motion import HALF_PI
from visual_servo_epipolar.core.mapping.adjustment.equations import Evaluation
from visual_servo_epipolar.core.mapping.adjustment.factors import ON_BASE, SCALE
from visual_servo_epipolar.core.mapping.adjustment.refinement import refine
from visual_servo_epipolar.core.mapping.adjustment.window import Unknowns
from visual_servo_epipolar.core.mapping.initialization import (
    refine_narrowing,
    shared_at,
    triangulate,
)
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount
from visual_servo_epipolar.simulation.point_world import PointSettings

TILT, ROLL, FORWARD, LEFT, YAW = 0.1, 0.05, 0.2, -0.1, 0.3
SETTINGS = DockPoseSettings(
    camera_tilt=TILT,
    camera_roll=ROLL,
    camera_forward=FORWARD,
    camera_left=LEFT,
    camera_yaw=YAW,
)
STEP = 1e-6


@pytest.fixture(scope='module')
def exact():
    """Return the true geometry of a drive without noise."""
    drive = Drive(
        start=(0.3, -2.0, 4.0),
        angular=0.2,
        mount=CameraMount(tilt=TILT, roll=ROLL, forward=FORWARD, left=LEFT, yaw=YAW),
        points=PointSettings(noise=0.0),
        odometry_noise=0.0,
    )
    *_, (search, _) = searches = list(drive.searched(SETTINGS, 8))
    window, factors = window_of(search.keys, 0.2), factors_along(search.keys, SETTINGS)
    poses = {s.last.place.stamp_ns: pose for s, pose in searches}
    views = np.array([view_at(poses[key.place.stamp_ns]) for key in search.keys])
    shared = np.concatenate([shared_at(np.array([TILT, ROLL])), factors.prior])
    count = len(window.ids)
    unknowns = Unknowns(views, shared, np.zeros((2, count)), np.ones(count))
    near = triangulate(window, unknowns, np.ones(len(views), bool))
    return Evaluation(window, replace(unknowns, inverse_depth=near), np.ones(count, bool), factors)


def view_at(pose):
    """Return the view of a base at a ``pose``, beside that of the photograph."""
    turn = pose.theta - HALF_PI
    along, aside = [np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]
    ahead = np.array([pose.y, -pose.x]) + FORWARD * np.array(along) + LEFT * np.array(aside)
    # From the photograph's camera, in its axes: it looks aside by the yaw.
    off = ahead - [FORWARD, LEFT]
    c, s = np.cos(YAW), np.sin(YAW)
    forward, left = c * off[0] + s * off[1], c * off[1] - s * off[0]
    return [-left, forward, turn, TILT, ROLL]


def test_the_truth_leaves_no_residuals(exact) -> None:
    assert exact.cost == pytest.approx(0.0, abs=1e-6)


def test_refinement_finds_the_truth_from_the_nearest_guess(exact) -> None:
    ratio = math.sqrt(FIRST_DISTANCES[1] / FIRST_DISTANCES[0])  # halfway between two of them
    true = exact.unknowns
    wrong = true.views * [ratio, ratio, 1.0, 1.0, 1.0] + [0.05, 0.0, 0.01, 0.0, 0.0]
    near = triangulate(exact.window, replace(true, views=wrong), np.ones(len(wrong), bool))
    start = replace(exact, unknowns=replace(true, views=wrong, inverse_depth=near))
    at, damping = refine_narrowing(start)
    geometry = refine(at, 40, damping)
    assert geometry.unknowns.views[:, :3] == pytest.approx(true.views[:, :3], abs=0.03)
    assert exact.factors.path_ratio(geometry.unknowns) < 0.2


def test_a_scale_of_the_odometry_is_found_where_it_is_free(exact) -> None:
    # The images and the mount do not tell it apart: only the odometry's own deviation holds it.
    factors, true = exact.factors, exact.unknowns
    longer = replace(factors, motions=factors.motions * [1.1, 1.1, 1.0])
    shared = true.shared.copy()
    shared[SCALE] = -np.log(1.1)
    residuals = longer.path_residuals(replace(true, shared=shared))
    assert residuals == pytest.approx(0.0, abs=1e-6)


def test_derivatives_are_those_of_the_residuals(exact) -> None:
    factors, at = exact.factors, exact.unknowns
    slopes, before = factors.slopes(at), factors.residuals(at)
    whole = np.concatenate([at.views.ravel(), at.shared])
    for j in range(len(whole)):
        moved = whole + STEP * np.eye(len(whole))[j]
        views = moved[: at.views.size].reshape(-1, 5)
        other = replace(at, views=views, shared=moved[at.views.size :])
        change = (factors.residuals(other) - before) / STEP
        assert change == pytest.approx(slopes[:, j], abs=1e-3 * max(np.abs(change).max(), 1.0))


def test_normal_equations_are_the_slope_of_the_cost(exact) -> None:
    factors, at = exact.factors, exact.unknowns
    shared = at.shared.copy()
    shared[ON_BASE] += [0.01, -0.02, 0.01]
    at = replace(at, shared=shared)
    _, vector = factors.equations(at)
    for j in range(ON_BASE.start, ON_BASE.stop):
        shift = STEP * np.eye(len(shared))[j]
        ends = [factors.cost(replace(at, shared=shared + sign * shift)) for sign in (1, -1)]
        slope = (ends[0] - ends[1]) / (4.0 * STEP)  # of half the cost
        assert vector[at.views.size + j] == pytest.approx(slope, rel=1e-3, abs=1e-3)
