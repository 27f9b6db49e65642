"""Disturbances: each does what it says, when it says, the same for the same seed and frame."""

from typing import Any

import numpy as np
import pytest

from visual_servo_epipolar.simulation.disturbances import Disturbances, DisturbanceSettings

SIZE = (320, 240)
GREY = np.full((240, 320), 100, dtype=np.uint8)
GRID = np.stack(np.meshgrid(np.arange(320.0), np.arange(240.0)), axis=-1).reshape(-1, 2)
KINDS: tuple[dict[str, Any], ...] = (
    {'light_step': -0.3},
    {'light_wave': 0.3},
    {'occlusion': 0.3},
    {'person': 0.8},
)


def textured() -> np.ndarray:
    return np.random.default_rng(3).integers(0, 256, (240, 320), dtype=np.uint8)


def disturbed(seed: int = 2, **changes: Any) -> Disturbances:
    timing = {'disturbed_from': 10, 'disturbed_for': 20}
    return Disturbances(SIZE, DisturbanceSettings(**{**timing, **changes}), seed)


def test_nothing_happens_by_default_and_the_image_is_a_copy() -> None:
    image = textured()
    same = disturbed().apply(image, 15)
    np.testing.assert_array_equal(same, image)
    assert not np.shares_memory(same, image)


@pytest.mark.parametrize('kind', KINDS)
def test_seed_and_frame_alone_decide(kind: dict[str, Any]) -> None:
    one, other, image = disturbed(**kind), disturbed(**kind), textured()
    before = image.copy()
    one.apply(image, 12)
    np.testing.assert_array_equal(one.apply(image, 17), other.apply(image, 17))
    np.testing.assert_array_equal(image, before)
    assert (one.apply(image, 17) != image).any()


@pytest.mark.parametrize('kind', KINDS[2:])
def test_what_passes_comes_back_after_its_period(kind: dict[str, Any]) -> None:
    often = disturbed(**kind, disturbed_every=25)
    image = textured()
    frames = (9, 20, 30, 34, 45, 59, 70)
    seen = [bool((often.apply(image, frame) != image).any()) for frame in frames]
    assert seen == [False, True, False, False, True, False, True]


def test_one_disturbance_must_end_before_the_next_begins() -> None:
    with pytest.raises(ValueError, match='0 or at least disturbed_for, got 19 and 20 frames'):
        disturbed(disturbed_every=19)


def test_the_light_stays_as_the_step_leaves_it() -> None:
    assert (disturbed(light_step=-0.3).apply(GREY, 9) == 100).all()
    assert (disturbed(light_step=-0.3).apply(GREY, 400) == 70).all()
    assert (disturbed(light_step=2.0).apply(GREY, 10) == 255).all()  # saturated, not wrapped


def test_slow_light_reaches_its_amplitude_and_no_more() -> None:
    slow = disturbed(light_wave=0.3)
    greys = [int(slow.apply(GREY, frame)[0, 0]) for frame in range(120)]
    assert (min(greys), max(greys)) == (70, 130)


def test_an_obstacle_slides_over_the_share_asked_for() -> None:
    obstacle = disturbed(occlusion=0.3)
    assert obstacle.hides(GRID, 20).mean() == pytest.approx(0.3, abs=0.005)
    assert obstacle.hides(GRID, 10).mean() < 0.2


@pytest.mark.parametrize('kind', [{'occlusion': 0.3}, {'person': 0.8}])
def test_what_hides_the_scene_is_where_the_image_changes(kind: dict[str, Any]) -> None:
    passer = disturbed(**kind)
    changed = (passer.apply(GREY, 21) != GREY).ravel()
    assert not (changed & ~passer.hides(GRID, 21)).any()


def test_a_person_walks_through() -> None:
    person = disturbed(person=0.8)
    hidden_pixels = [GRID[person.hides(GRID, frame)] for frame in (14, 20, 26)]
    assert np.diff([pixels[:, 0].mean() for pixels in hidden_pixels]).min() > 50.0
    assert np.ptp(hidden_pixels[1][:, 1]) > 0.7 * SIZE[1]


def test_points_outside_the_image_are_hidden_by_nothing() -> None:
    outside = np.array([[-5.0, 3.0], [1e9, 3.0], [np.nan, np.nan]])
    assert not disturbed(occlusion=0.9).hides(outside, 20).any()
