"""The bench of consistency: errors over what is stated, part by part."""

from dataclasses import replace
import math

import numpy as np
import pytest
from servo_states import reading, SETTINGS, sight

from visual_servo_epipolar.core.estimate.goal_estimate import BaseModel, goal_estimate
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.evaluation.benchmarks import consistency
from visual_servo_epipolar.simulation.scenario import Scenario

SCENARIO = Scenario()
POSE = Pose.from_start(0.2, -1.0, 10.0)


def test_errors_of_as_many_deviations_in_each_part_are_that_squared() -> None:
    covariance, known = np.diag([0.01, 0.02, 0.003]) ** 2, SETTINGS.extrinsics
    exact = replace(known, covariance=np.zeros_like(known.covariance))
    seen = replace(
        sight(),
        offset=(POSE.x + 0.02, POSE.y - 0.04),
        heading_error=POSE.heading_error + 0.009 + 2.0 * math.pi,
    )
    said = goal_estimate(seen, reading(pose_covariance=covariance), exact, BaseModel())
    assert consistency.ratios(said, POSE) == pytest.approx([(4.0 + 4.0 + 9.0) / 3.0, 4.0, 9.0])


def test_each_run_has_a_world_of_its_own_as_the_servo_expects_them() -> None:
    worlds = [consistency.drawn(SCENARIO, seed) for seed in range(200)]
    mounts = [[it.camera.mount_yaw, it.camera.mount_forward, it.base.slip] for it in worlds]
    root = np.sqrt(np.mean(np.square(mounts), axis=0))
    servo = SCENARIO.servo
    expected = [servo.camera_yaw_deviation, servo.camera_forward_deviation, 0.05]
    assert root == pytest.approx(expected, rel=0.2)
    assert consistency.drawn(SCENARIO, 3) == worlds[3]


def test_its_table_has_a_row_for_each_law_and_counts_images_after_the_first_second() -> None:
    document = consistency.run(seed=0, quick=True, say=lambda text: None)
    assert [row['law'] for row in document['rows']] == list(consistency.LAWS)
    assert all(row['images'] > 10 and row['nees'][0] > 0.0 for row in document['rows'])
    lines = consistency.table(document).splitlines()
    assert len(lines) == 4 + len(consistency.LAWS)
