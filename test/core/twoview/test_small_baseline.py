"""Near the goal, where no epipoles are: the noise is learnt, and what counts for D."""

from dataclasses import replace
import math

import numpy as np
import pytest
from strategies import CAMERA, matches

from visual_servo_epipolar.core.geometry.motion import HALF_PI, Pose
from visual_servo_epipolar.core.geometry.rotation import fit_rotation
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.twoview.general_motion import noise_of_small_baseline
from visual_servo_epipolar.core.twoview.memory import PerceptionMemory
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.perceive import perceive
from visual_servo_epipolar.core.twoview.validation import noise_learnt

FOCAL = 769.0
SETTINGS = ServoSettings()
POSES = [Pose(0.0, 0.0, HALF_PI), Pose(0.004, -0.003, HALF_PI + 0.05), Pose(-0.01, 0.0, 1.5)]
WRONG = 0.05  # part of the matches


def seen(pose: Pose, noise_px: float, frame: int) -> Observation:
    """Return a view of 100 matches at ``pose``, blurred; some of them are wrong."""
    rng = np.random.default_rng(frame)
    current, desired = matches(pose, count=100)
    pixels = (CAMERA.pixels(rays) for rays in (current, desired))
    current, desired = (CAMERA.rays(p + noise_px * rng.standard_normal(p.shape)) for p in pixels)
    wrong = rng.random(len(current)) < WRONG
    current[wrong] = current[rng.permutation(len(current))][wrong]
    return Observation(frame, current, desired, FOCAL)


def learnt(pose: Pose, noise_px: float, settings: ServoSettings = SETTINGS) -> PerceptionMemory:
    memory = None
    for frame in range(50):
        perception = perceive(seen(pose, noise_px, frame), settings, frame, memory)
        assert perception.measurement.bearings is None
        memory = perception.memory
    assert memory is not None
    return memory


@pytest.mark.parametrize('pose', POSES)
@pytest.mark.parametrize('noise_px', [0.1, 0.3, 0.6])
def test_the_noise_is_learnt_where_there_is_no_baseline(pose: Pose, noise_px: float) -> None:
    assert learnt(pose, noise_px).noise == pytest.approx(noise_px, rel=0.3)  # 1.03 to 1.25 times


def test_no_twist_waits_for_the_noise() -> None:
    view = seen(POSES[0], 1.0, 0)
    first = perceive(view, SETTINGS, 0)
    assert first.measurement.noise_px == first.memory.noise == SETTINGS.pixel_noise
    memory = noise_learnt(first.memory)
    assert memory.noise > SETTINGS.pixel_noise
    assert noise_learnt(memory) is memory
    # A memory that did not learn after the twist does so before the next one.
    later = [perceive(view, SETTINGS, 1, each).measurement for each in (first.memory, memory)]
    assert [each.noise_px for each in later] == [memory.noise] * 2


def test_through_an_unknown_lens_nothing_is_learnt_of_a_turn() -> None:
    settings = replace(SETTINGS, focal_deviation=1.0)
    assert learnt(POSES[0], 0.1, settings).noise == SETTINGS.pixel_noise


@pytest.mark.parametrize('angle', np.linspace(-math.pi, math.pi, 7))
@pytest.mark.parametrize('baseline', [0.003, 0.02, 0.1])
def test_a_motion_in_any_direction_leaves_the_noise_alone(angle: float, baseline: float) -> None:
    pose = Pose(baseline * math.cos(angle), baseline * math.sin(angle), HALF_PI + 0.02)
    found = []
    for frame in range(10):
        view = seen(pose, 0.2, frame)
        rotation = fit_rotation(view.current, view.desired).rotation
        views = view.current, view.desired, view.resolution
        found.append(noise_of_small_baseline(*views, rotation, 0.3))
    assert 0.13 < np.mean(found) < 0.27


@pytest.mark.parametrize('which', ['alike', 'on a line', 'few'])
def test_degenerate_rays_are_no_error(which: str) -> None:
    current, desired = matches(POSES[1], count=100)
    if which == 'alike':
        current, desired = np.tile(current[:1], (20, 1)), np.tile(desired[:1], (20, 1))
    elif which == 'few':
        current, desired = current[:3], desired[:3]
    else:
        current[:, 1] = desired[:, 1] = 0.0
    pixel = np.full((len(current), 2), 1e-3)
    assert noise_of_small_baseline(current, desired, pixel, np.eye(3), 0.3) > 0.0


def test_d_counts_what_agrees_on_one_geometry() -> None:
    current, desired = matches(Pose(0.0, -1.0, HALF_PI), count=100)
    exact = perceive(Observation(0, current, desired, FOCAL), SETTINGS, 0).measurement
    half = np.arange(100) % 2 == 0
    current[half] = current[np.random.default_rng(0).permutation(100)][half]
    mixed = perceive(Observation(0, current, desired, FOCAL), SETTINGS, 0).measurement
    assert mixed.inliers == pytest.approx(50, abs=6)
    assert mixed.difference == pytest.approx(exact.difference, rel=0.2)
