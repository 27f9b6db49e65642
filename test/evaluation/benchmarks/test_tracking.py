"""The tracking benchmark: its truth is right, its counts are right, its table can be printed."""

from dataclasses import replace
import json

import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.evaluation.benchmarks import tracking
from visual_servo_epipolar.evaluation.benchmarks.tracking import recovery_time, scores
from visual_servo_epipolar.evaluation.benchmarks.tracking_world import (
    approach,
    FrameErrors,
    RenderedWorld,
    RINGS,
    STANDING,
    start_of,
)

CAMERA = replace(
    tracking.QUICK.camera,
    width=320,
    height=240,
    focal_length=192.0,
    principal_u=159.5,
    principal_v=119.5,
)
BEHIND = Pose(0.2, -1.5, DESIRED_POSE.theta + 0.05)


@pytest.fixture(scope='module')
def world() -> RenderedWorld:
    return RenderedWorld(CAMERA)


def pixels_of(seed: int = 0, count: int = 200) -> np.ndarray:
    return np.random.default_rng(seed).uniform((20.0, 20.0), (300.0, 220.0), (count, 2))


def true_features(world: RenderedWorld, pose: Pose) -> Features:
    """Return open features at their true places."""
    desired = pixels_of()
    points, clearance = world.truth.points(desired)
    current, inside = world.renderer.project(points, pose)
    tracked = inside & (clearance > RINGS[0])
    ids = np.flatnonzero(tracked)
    return Features(ids, current[ids], desired[ids], np.ones(len(ids)), np.zeros(len(ids)))


def counted(world: RenderedWorld, shift: np.ndarray) -> FrameErrors:
    """Return features at the goal, all of them ``shift`` from their places."""
    true = true_features(world, DESIRED_POSE)
    shifted = replace(true, current=true.current + shift)
    return world.truth.errors(shifted, DESIRED_POSE, None, 0)


@pytest.mark.parametrize('seed', range(5))
def test_an_approach_ends_at_the_goal_and_looks_where_it_goes(seed: int) -> None:
    poses = approach(start_of(seed, 200), 200)
    assert len(poses) == 200
    assert poses[-STANDING:] == [DESIRED_POSE] * STANDING
    steps = np.diff([(pose.x, pose.y) for pose in poses[:-STANDING]], axis=0)[:-1]
    ways = np.arctan2(steps[:, 1], steps[:, 0])
    assert np.abs(ways - [pose.theta for pose in poses[: len(ways)]]).max() < 0.02
    assert np.hypot(*steps.T).max() / 0.09 < 0.35  # m/s


def test_features_at_their_true_places_have_no_error(world: RenderedWorld) -> None:
    frame_errors = world.truth.errors(true_features(world, BEHIND), BEHIND, None, 0)
    assert frame_errors.trackable.sum() > 30
    assert frame_errors.distances.max() < 1e-9


def test_what_the_room_hides_is_not_seen(world: RenderedWorld) -> None:
    # What is behind the robot when it looks back is in no image.
    back = Pose(0.0, 0.0, -DESIRED_POSE.theta)
    frame_errors = world.truth.errors(true_features(world, DESIRED_POSE), back, None, 0)
    assert not frame_errors.visible.any()
    assert np.isinf(frame_errors.distances).all()


def test_edges_of_depth_are_where_the_depth_jumps(world: RenderedWorld) -> None:
    desired = pixels_of()
    points, clearance = world.truth.points(desired)
    beside, _ = world.truth.points(desired + [2.0, 0.0])
    jumps = np.abs(beside[:, 1] - points[:, 1]) > 0.5
    assert jumps.any()
    assert (clearance[jumps] <= RINGS[0]).all()
    assert 0.5 < (clearance > RINGS[0]).mean() < 1.0


@pytest.mark.parametrize('moved', [(0.004, 0.0, 0.0), (0.0, -0.006, 0.0), (0.002, 0.001, 0.003)])
def test_the_pose_error_is_the_shift_that_was_made(
    world: RenderedWorld, moved: tuple[float, float, float]
) -> None:
    x, y, turn = moved
    features = true_features(world, Pose(x, y, DESIRED_POSE.theta + turn))
    frame_errors = world.truth.errors(features, DESIRED_POSE, None, 0)
    # Linear about the goal; the second order of some millimetres is a few hundredths of them.
    assert world.truth.pose_error(frame_errors) == pytest.approx(moved, abs=2e-4)


def test_scores_count_what_is_off_its_place(world: RenderedWorld) -> None:
    shift = np.zeros((len(true_features(world, DESIRED_POSE)), 2))
    good = counted(world, shift + [0.3, 0.4])
    shift[2] = [30.0, 40.0]
    bad = counted(world, shift)
    figures = scores(world.truth, [good] * 20 + [bad] * STANDING)
    assert figures['route_px'] == pytest.approx(0.5)
    assert (figures['gross'], figures['gross_tracks']) == (STANDING, 1)
    assert figures['fewest'] == len(shift)


def test_recovery_is_counted_from_the_last_frame_with_too_few(world: RenderedWorld) -> None:
    many = counted(world, np.zeros(2))
    few = world.truth.errors(Features(), DESIRED_POSE, None, 0)
    assert recovery_time([few, many, many], 1) == 0
    assert recovery_time([many, many, few, many], 1) == 2
    assert recovery_time([many, few], 1) is None


def test_a_tiny_plan_gives_figures_that_json_and_the_table_take() -> None:
    plan = replace(
        tracking.QUICK, frames=8 + STANDING, camera=CAMERA, disturbances=('occluder at once',)
    )
    progress: list[str] = []
    document = json.loads(json.dumps(tracking.measure(plan, 0, progress.append), allow_nan=False))
    text = tracking.table(document)
    assert progress and all(name in text for name in tracking.CONFIGURATIONS)
    assert 'occluder at once' in text
    assert [it['size'] for it in document['over_floor']] == [[320, 240]]
    floor = document['over_floor'][0]
    assert 0.0 < floor['ratio_low'] <= floor['ratio'] <= floor['ratio_high']
    assert floor['ratio_high'] <= floor['ratio_worst'] and 'ratio to one pyramid' in text
    assert document['scenes'][0]['configurations']['anchored']['goal_px'] < 0.5
