"""Matching: weak photographs, and other places."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.tracking.candidates import Candidates, STRONG
from visual_servo_epipolar.core.tracking.matchers.sift import detect, ENOUGH
from visual_servo_epipolar.core.tracking.matching import desired_view, match
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

SMALL = CameraSettings(
    width=320, height=256, focal_length=192.3, principal_u=158.4, principal_v=127.6
)
POOR = replace(SMALL, scene='plain')
START = Pose.from_start(0.6, -3.0, 8.0)


@cache
def world(settings: CameraSettings) -> CameraSimulator:
    return CameraSimulator(settings)


def photograph(settings: CameraSettings) -> np.ndarray:
    return world(settings).photograph()


@pytest.mark.parametrize('shape', [(1, 1), (1, 300), (300, 1), (15, 400), (8, 8)])
@pytest.mark.parametrize('halved', [False, True])
def test_a_sliver_of_an_image_has_no_keypoints(shape: tuple[int, int], halved: bool) -> None:
    image = np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)
    for enlargement in (1, 2):
        assert len(detect(image, limit=100, enlargement=enlargement, halved=halved)) == 0


def test_an_image_that_is_too_long_to_be_sampled_is_refused() -> None:
    image = np.random.default_rng(0).integers(0, 256, (16, 32767)).astype(np.uint8)
    with pytest.raises(ValueError, match='sides of at most 32766 px, got 32767x16'):
        desired_view(image)


def test_a_poor_photograph_shows_enough_at_twice_its_size() -> None:
    image = photograph(POOR)
    view = desired_view(image)
    assert len(detect(image, limit=4000)) < ENOUGH <= len(view.keypoints)


def lit(image: np.ndarray, share: float, noise: float, seed: int = 0) -> np.ndarray:
    """Return the image with a share of its light, and noise of its own."""
    noisy = share * image + noise * np.random.default_rng(seed).standard_normal(image.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(('share', 'noise'), [(0.15, 1.0), (0.3, 2.0), (0.3, 0.0)])
def test_a_dim_image_shows_the_photograph_as_a_bright_one_does(share: float, noise: float) -> None:
    view = desired_view(photograph(SMALL))
    perfect = world(SMALL).renderer.render(START)
    bright = len(match(view, lit(perfect, 1.0, 2.0)).indices)
    assert len(match(view, lit(perfect, share, noise)).indices) > 0.4 * bright


@pytest.mark.parametrize('deviation', [0.0, 0.5, 2.0, 8.0])
@pytest.mark.parametrize('grey', [12, 128])
def test_a_blank_wall_is_no_photograph_however_noisy(grey: int, deviation: float) -> None:
    wall = np.full((480, 640), grey) + np.linspace(0.0, 10.0, 640)  # nearer to a lamp on the right
    with pytest.raises(TrackingError, match='take the photograph where there is texture'):
        desired_view(lit(wall, 1.0, deviation))


@pytest.mark.parametrize('quick', [False, True])
def test_matches_of_a_poor_photograph_are_where_the_room_says(quick: bool) -> None:
    view = desired_view(photograph(POOR))
    matches = match(view, world(POOR).capture(START, 0), quick=quick)
    assert len(matches.indices) >= 12
    points = world(POOR).renderer.trace(view.keypoints.pixels[matches.indices], DESIRED_POSE)
    truth, _ = world(POOR).renderer.project(points, START)
    assert np.median(np.hypot(*(truth - matches.pixels).T)) < 1.0


@pytest.mark.parametrize('other', [replace(SMALL, scene_seed=2), POOR])
def test_a_photograph_of_another_room_is_not_seen(other: CameraSettings) -> None:
    for taken, seen in ((SMALL, other), (other, SMALL)):
        view = desired_view(photograph(taken))
        with pytest.raises(TrackingError, match='the photograph is not seen from here'):
            match(view, world(seen).capture(START, 0))


def test_noise_shows_no_photograph() -> None:
    view = desired_view(photograph(POOR))
    for seed in range(3):
        noise = np.random.default_rng(seed).integers(0, 256, (256, 320)).astype(np.uint8)
        with pytest.raises(TrackingError, match='the photograph is not seen from here'):
            match(view, noise)


def test_weak_features_are_tracked_only_where_strong_ones_are_too_few() -> None:
    view = desired_view(photograph(SMALL))
    strong, ids = view.deviations <= STRONG, np.arange(len(view.keypoints))
    count, nothing = int(strong.sum()), np.zeros(len(ids), bool)
    assert 60 <= count < len(ids)  # both kinds
    candidates = Candidates(view)
    assert strong[candidates.bucketed(ids, nothing, 60)].all()
    more = candidates.bucketed(ids, nothing, count + 20)
    assert strong[more].sum() == count
    assert len(more) == count + 20
    tracked = ~strong & (np.cumsum(~strong) <= 20)
    kept = candidates.bucketed(ids, tracked, 60)
    assert tracked[kept].any()
    assert (strong | tracked)[kept].all()
