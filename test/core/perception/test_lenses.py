"""Observations through any lens: what it cannot place is dropped, and D is of the sphere."""

from dataclasses import replace

import numpy as np
import pytest

from visual_servo_epipolar.core.cameras.dual_fisheye import LAYOUTS
from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.cameras.equirectangular import STITCHED
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.cameras.registry import camera_of_size
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.perception.measures import (
    difference_deviation,
    feature_difference,
    usual_difference,
)
from visual_servo_epipolar.core.perception.observation import observe, OTHER_LENS
from visual_servo_epipolar.core.perception.perceive import perceive
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.tracking.features import Features

SIZE = {'width': 1280, 'height': 1024}
FOLDING = Camera(**SIZE, fx=769.0, fy=769.0, cx=635.0, cy=512.0, distortion=(-0.45, 0.0, 0.0, 0.0))
FISHEYE = Equidistant(**SIZE, fx=396.0, fy=396.0, cx=639.5, cy=511.5)


def features(count: int = 50, seed: int = 0) -> Features:
    """Return features anywhere in the image."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform(0.0, 1.0, (2, count, 2)) * [1279.0, 1023.0]
    numbers = np.arange(count)
    return Features(numbers, pixels[0], pixels[1], numbers, np.zeros(count))


def test_what_the_lens_cannot_place_is_dropped_from_both_views() -> None:
    seen = features()
    usable = [
        FOLDING.round_trips(pixels, FOLDING.rays(pixels))
        for pixels in (seen.current, seen.desired)
    ]
    kept = usable[0] & usable[1]
    assert 0 < kept.sum() < usable[0].sum() < len(seen)
    observation = observe(seen, FOLDING, 7)
    assert (observation.dropped, len(observation)) == (len(seen) - kept.sum(), kept.sum())
    np.testing.assert_array_equal(observation.current, FOLDING.rays(seen.current[kept]))
    np.testing.assert_array_equal(observation.desired, FOLDING.rays(seen.desired[kept]))
    resolution = FOLDING.resolution(observation.desired)
    np.testing.assert_array_equal(observation.resolution[:, 1], resolution)
    assert np.isfinite(observation.resolution).all()


def test_of_a_lens_that_places_all_nothing_is_dropped() -> None:
    lens = Camera(
        **SIZE, fx=769.0, fy=769.0, cx=635.0, cy=512.0, distortion=(-0.2, 0.05, 0.0, 0.0)
    )
    for camera in (lens, replace(lens, distortion=()), FISHEYE):
        observation = observe(features(), camera, 0)
        assert (observation.dropped, len(observation)) == (0, 50)
        assert observation.wide == (camera is FISHEYE)


def test_nothing_that_is_seen_leaves_an_empty_observation() -> None:
    seen = features()
    corners = replace(seen, current=np.full((50, 2), 3.0), desired=np.full((50, 2), 3.0))
    observation = observe(corners, FOLDING, 0)
    assert (observation.dropped, len(observation)) == (50, 0)
    perception = perceive(observation, ServoSettings(), 0)
    assert perception.measurement.reason.startswith('0 features')


def sphere(count: int = 200) -> np.ndarray:
    """Return points all around, 3 to 8 m away, in axes of the camera at the goal."""
    rng = np.random.default_rng(1)
    points = normalised(rng.standard_normal((count, 3)))
    return np.asarray(points * rng.uniform(3.0, 8.0, (count, 1)))


def test_d_of_the_sphere_is_that_of_the_plane_at_small_angles() -> None:
    points = np.array([[0.02, 0.01, 3.0], [-0.03, 0.02, 4.0]])
    current, desired = normalised(points - [0.0, 0.0, 0.3]), normalised(points)
    plane, wide = (feature_difference(current, desired, kind) for kind in (False, True))
    assert wide == pytest.approx(plane, rel=1e-3)


@pytest.mark.parametrize('part', ['all around', 'behind alone'])
def test_d_of_the_sphere_falls_with_the_distance_to_the_goal_from_either_side(part: str) -> None:
    points = sphere()
    points = points[points[:, 2] < 0.0] if part == 'behind alone' else points
    desired = normalised(points)
    values = [
        float(feature_difference(normalised(points - [0.0, 0.0, z]), desired, True))
        for z in np.linspace(-2.0, 2.0, 21)
    ]
    assert (np.diff(values) > 0.0).all()
    assert values[10] == 0.0


def test_the_stated_deviation_of_d_is_what_noise_makes() -> None:
    rng, desired = np.random.default_rng(2), normalised(sphere(60))
    values = []
    for _ in range(2000):
        both = (normalised(desired + 1e-3 * rng.standard_normal(desired.shape)) for _ in range(2))
        values.append(float(usual_difference(*both, True)))
    stated = float(difference_deviation(desired, desired, 1e-3, True))
    assert float(np.std(values)) == pytest.approx(stated, rel=0.1)


@pytest.mark.parametrize('name', [*LAYOUTS, STITCHED])
def test_a_feature_that_another_lens_sees_than_in_the_photograph_is_uncertain(name: str) -> None:
    camera = camera_of_size(name, (640, 320))
    ahead = normalised(np.random.default_rng(4).uniform([-1, -1, 0.5], 1.0, (12, 3)))
    behind = ahead * [-1.0, 1.0, -1.0]
    current, desired = np.concatenate([ahead, ahead]), np.concatenate([ahead, behind])
    numbers = np.arange(24)
    pixels = camera.pixels(current), camera.pixels(desired)
    seen = observe(Features(numbers, *pixels, numbers, np.zeros(24)), camera, 7)
    same, other = seen.resolution[:12], seen.resolution[12:]
    np.testing.assert_allclose(other, OTHER_LENS * same)
    np.testing.assert_allclose(same[:, 0], camera.resolution(ahead))
