"""Renewal: a key view keeps photographs of other light; its first one rules, and stays."""

from dataclasses import replace

import numpy as np
import pytest
from routes import key_view, route_of

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.routes.key_view_tracker import _described
from visual_servo_epipolar.core.routes.places import PlaceFinder
from visual_servo_epipolar.core.routes.route import Appearance, in_memory, RouteView

ROWS = np.arange(3, 9)


def lit(image: Image, side: int) -> Image:
    """Return an image by a lamp at one side."""
    fall = np.linspace(*((0.05, 1.0), (1.0, 0.05))[side % 2], image.shape[1 - side // 2])
    fall = fall if side < 2 else fall[:, None]
    return (image * fall).astype(np.uint8)


def by_lamp(view: RouteView, side: int, shift: int = 0) -> Appearance:
    """Return what a key view looks like by a lamp, moved down by some pixels."""
    keypoints = view.keypoints.take(ROWS)
    pixels = keypoints.pixels + [0.0, shift]
    image = np.roll(lit(view.image, side), shift, axis=0)
    return Appearance(in_memory(image), replace(keypoints, pixels=pixels), ROWS)


@pytest.fixture
def view() -> RouteView:
    image = np.repeat(
        np.repeat(np.arange(12, dtype=np.uint8).reshape(3, 4) * 17 + 40, 16, 0), 16, 1
    )
    return replace(key_view(1), load=in_memory(image))


def test_what_looks_like_a_photograph_is_not_kept(view: RouteView) -> None:
    same = Appearance(view.load, view.keypoints.take(ROWS), ROWS)
    assert view.renewed_by(same, 3).renewed == ()


def test_light_from_another_side_is_kept_once(view: RouteView) -> None:
    renewed = view.renewed_by(by_lamp(view, 0), 3)
    assert len(renewed.renewed) == 1
    assert renewed.renewed_by(by_lamp(view, 0, shift=2), 3).renewed == renewed.renewed


def test_no_more_are_kept_than_asked_for_and_the_first_always(view: RouteView) -> None:
    renewed = view
    for side in (0, 1, 2, 3):
        renewed = renewed.renewed_by(by_lamp(view, side), 2)
        assert len(renewed.renewed) <= 2 and renewed.load is view.load
    assert len(renewed.renewed) == 2


def test_places_are_looked_for_in_all_photographs_of_a_key_view(view: RouteView) -> None:
    renewed = view.renewed_by(by_lamp(view, 0), 3)
    finder = PlaceFinder(route_of(key_view(0), renewed, key_view(2)))
    index = finder._index
    assert len(index._descriptors) == len(index._owners) == 12 + 13 + len(ROWS) + 14
    assert (index._owners == 1).sum() == 13 + len(ROWS)


def test_descriptors_are_of_today_where_today_shows_the_keypoint() -> None:
    rng = np.random.default_rng(0)
    image = np.repeat(np.repeat(rng.integers(0, 255, (30, 40), np.uint8), 8, 0), 8, 1)
    keypoints = key_view(1).keypoints
    described = _described(keypoints, keypoints.pixels + 100.0, image)
    same = (described.descriptors == keypoints.descriptors).all(axis=1)
    assert not same.all() and np.array_equal(described.pixels, keypoints.pixels + 100.0)
