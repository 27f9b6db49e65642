"""The tracking benchmark: its truth is right, its counts are right, its table can be printed."""

from dataclasses import replace
import json

import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.evaluation.benchmarks import tracking
from visual_servo_epipolar.evaluation.benchmarks.tracking import (
    approach,
    FrameErrors,
    scores,
    STANDING,
    start_of,
    TrueFeatures,
)
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator

CAMERA = tracking.QUICK.camera.resized(320, 240)


@pytest.fixture(scope='module')
def truth() -> TrueFeatures:
    return TrueFeatures(CameraSimulator(CAMERA).renderer)


def pixels_of(seed: int = 0, count: int = 200) -> np.ndarray:
    return np.random.default_rng(seed).uniform((20.0, 20.0), (300.0, 220.0), (count, 2))


def true_features(truth: TrueFeatures, pose: Pose) -> Features:
    """Return open features at their true places."""
    desired = pixels_of()
    points, on_edge = truth.points(desired)
    current, inside = truth.renderer.project(points, pose)
    ids = np.flatnonzero(inside & ~on_edge)
    return Features(ids, current[ids], desired[ids], np.ones(len(ids)), np.zeros(len(ids)))


def counted(truth: TrueFeatures, shift: np.ndarray) -> FrameErrors:
    """Return features at the goal, all of them ``shift`` from their places."""
    true = true_features(truth, DESIRED_POSE)
    shifted = replace(true, current=true.current + shift)
    return truth.errors(shifted, DESIRED_POSE)


@pytest.mark.parametrize('seed', range(5))
def test_an_approach_ends_at_the_goal_and_looks_where_it_goes(seed: int) -> None:
    poses = approach(start_of(seed, 200), 200)
    assert len(poses) == 200
    assert poses[-STANDING:] == [DESIRED_POSE] * STANDING
    steps = np.diff([(pose.x, pose.y) for pose in poses[:-STANDING]], axis=0)[:-1]
    ways = np.arctan2(steps[:, 1], steps[:, 0])
    assert np.abs(ways - [pose.theta for pose in poses[: len(ways)]]).max() < 0.02
    assert np.hypot(*steps.T).max() / 0.09 < 0.35  # m/s


def test_what_the_room_hides_is_not_seen(truth: TrueFeatures) -> None:
    # What is behind the robot when it looks back is in no image.
    back = Pose(0.0, 0.0, -DESIRED_POSE.theta)
    frame_errors = truth.errors(true_features(truth, DESIRED_POSE), back)
    assert not frame_errors.trackable.any()
    assert np.isinf(frame_errors.distances).all()


def test_edges_of_depth_are_where_the_depth_jumps(truth: TrueFeatures) -> None:
    desired = pixels_of()
    points, on_edge = truth.points(desired)
    beside, _ = truth.points(desired + [2.0, 0.0])
    jumps = np.abs(beside[:, 1] - points[:, 1]) > 0.5
    assert jumps.any()
    assert on_edge[jumps].all()
    assert 0.0 < on_edge.mean() < 0.5


def test_scores_count_what_is_off_its_place(truth: TrueFeatures) -> None:
    shift = np.zeros((len(true_features(truth, DESIRED_POSE)), 2))
    good = counted(truth, shift + [0.3, 0.4])
    shift[2] = [30.0, 40.0]
    bad = counted(truth, shift)
    figures = scores([good] * 20 + [bad] * STANDING)
    assert figures['route_px'] == pytest.approx(0.5)
    assert figures['gross'] == STANDING
    assert figures['fewest'] == len(shift)


def test_a_tiny_plan_gives_figures_that_json_and_the_table_take() -> None:
    plan = replace(tracking.QUICK, frames=8 + STANDING, camera=CAMERA)
    progress: list[str] = []
    document = json.loads(json.dumps(tracking.measure(plan, 0, progress.append), allow_nan=False))
    text = tracking.table(document)
    assert progress and all(name in text for name in tracking.CONFIGURATIONS)
    assert document['rows'][0]['goal_px'] < 0.5
