"""Rigs drive home with what their drivers give: rates that fall, images that are compressed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.stamps import period_ns
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.closed_loop import Loop
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.mounts.registry import new_rig
from visual_servo_epipolar.simulation.run_monitor import verdict
from visual_servo_epipolar.simulation.scenario import load
from visual_servo_epipolar.simulation.views import drive, view_of

RIGS = Path(__file__).parents[2] / 'config/rigs'
SEED = 3


@pytest.mark.parametrize(
    ('rig', 'start', 'falls'),
    [('panorama_small', (0.8, 0.4, -150.0), 40), ('pan', (0.6, -0.8, 80.0), 30)],
)
def test_a_rate_that_falls_from_thirty_to_four_is_no_harm(rig, start, falls) -> None:
    scenario = load(None, RIGS / f'{rig}.yaml').seeded(SEED)
    scenario = replace(scenario, camera=replace(scenario.camera, frame_rate=30.0))
    view = view_of(scenario, 'features', SEED)
    loop = Loop(scenario.loop(start, SEED), view, scenario.camera.nominal_camera)
    rng = np.random.default_rng(SEED)

    def fall(sample: Sample) -> None:
        if loop.frame > falls:
            loop._period_ns = period_ns(rng.uniform(2.0, 5.0))

    result = verdict(loop.run(watch=fall), new_rig(scenario.camera))
    assert result['outcome'] == 'arrived', result['reason']
    assert result['position_error_m'] < 0.003 and result['max_distance_ratio'] < 1.1


# A stitcher knows how the lens behind is turned; where both images come as they are, nobody does.
@pytest.mark.parametrize(
    ('rig', 'turned'),
    [('dual_fisheye', (-0.009, 0.0, 0.019)), ('panorama_stitched', (0.0, 0.0, 0.0))],
)
def test_two_centres_that_nobody_tells_move_the_goal_by_millimetres_at_most(rig, turned) -> None:
    scenario = load(None, RIGS / f'{rig}.yaml').seeded(SEED)
    camera = replace(scenario.camera, lens_rotation=turned)
    scenario = replace(scenario, camera=camera)
    log = drive(scenario, (0.8, 0.4, -120.0), SEED)
    result = verdict(log, new_rig(scenario.camera))
    assert result['outcome'] == 'arrived', result['reason']
    assert result['position_error_m'] < 0.008 and result['max_distance_ratio'] < 1.1


def test_a_turn_about_another_lens_is_not_taken_for_a_way() -> None:
    scenario = load(None, RIGS / 'dual_fisheye.yaml').seeded(seed := 274359773)
    start = (1.368867, -0.371214, -14.415847)  # its distance was 5 cm after a turn in place
    log = drive(scenario, start, seed)
    result = verdict(log, new_rig(scenario.camera))
    assert result['outcome'] == 'arrived', result['reason']
    assert result['duration_s'] < 30.0 and result['position_error_m'] < 0.008


def test_a_jpeg_is_nearly_the_image_and_the_same_each_time() -> None:
    settings = CameraSettings(width=160, height=120, focal_length=96.0, noise=0.0)
    plain = CameraSimulator(settings).photograph()
    first, again = (CameraSimulator(replace(settings, jpeg=50)).photograph() for _ in range(2))
    np.testing.assert_array_equal(first, again)
    difference = np.abs(first.astype(int) - plain)
    assert 0 < difference.max() and difference.mean() < 4.0
