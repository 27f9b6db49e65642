"""Templates of a photograph: made once, and never more of them than there is room for."""

import cv2
import numpy as np
import pytest

from visual_servo_epipolar.core.tracking.alignment import templates as module
from visual_servo_epipolar.core.tracking.alignment.sampling import float_image, PatchGrid
from visual_servo_epipolar.core.tracking.alignment.template_alignment import Anchor
from visual_servo_epipolar.core.tracking.alignment.templates import LEVELS, Templates
from visual_servo_epipolar.core.tracking.alignment.warps import Warps

MOST, COUNT = 48, 20


@pytest.fixture
def cache(monkeypatch) -> Templates:
    monkeypatch.setattr(module, 'MOST', MOST)
    image = np.random.default_rng(0).integers(0, 256, (120, 160), dtype=np.uint8)
    return Templates(image, PatchGrid(5))


def points(ids: np.ndarray) -> np.ndarray:
    return np.stack([20.0 + ids % 100, 20.0 + ids // 100], axis=1)


def level(number: int) -> np.ndarray:
    return np.full(COUNT, number % LEVELS)


def test_a_robot_that_is_up_for_weeks_has_no_more_templates_than_there_is_room_for(cache) -> None:
    for number in range(200):  # features come and go, nearer and farther
        ids = np.arange(COUNT) + 13 * number
        cache.stacked(ids, points(ids), level(number))
        cache.patch(int(ids[0]) + 7, points(ids)[0], 1)
    # Beside those that fit there may be those in use: of two frames, and of this one.
    assert len(cache._rows) <= MOST + 3 * COUNT
    assert len(cache._stored) <= 2 * (MOST + 3 * COUNT)


def test_a_template_that_was_dropped_is_made_as_before(cache) -> None:
    first = np.arange(COUNT)
    before = cache.stacked(first, points(first), level(2)).copy()
    for number in range(1, 20):
        others = first + 1000 * number
        cache.stacked(others, points(others), level(number))
    assert (0, 2) not in cache._rows
    np.testing.assert_array_equal(cache.stacked(first, points(first), level(2)), before)


def test_what_is_in_use_stays_when_room_is_made(cache) -> None:
    tracked = np.arange(COUNT)
    expected = cache.stacked(tracked, points(tracked), level(0)).copy()
    for number in range(1, 30):
        others = tracked + 1000 * number
        cache.stacked(others, points(others), level(number))
        stacked = cache.stacked(tracked, points(tracked), level(0))
        np.testing.assert_array_equal(stacked, expected)
        assert {(k, 0) for k in range(COUNT)} <= set(cache._rows)


def test_light_that_grows_across_a_patch_is_no_motion() -> None:
    texture = np.random.default_rng(1).normal(size=(120, 160))
    image = cv2.GaussianBlur(texture, (0, 0), 3.0)
    image = (110.0 + 40.0 * image / image.std()).clip(0, 255).astype(np.uint8)
    points = np.stack(np.meshgrid([40.0, 80.0, 120.0], [40.0, 80.0]), axis=-1).reshape(-1, 2)
    ids = np.arange(len(points))
    start = Warps(ids, points, points + 0.3, np.tile(np.eye(2), (len(points), 1, 1)))
    anchor = Anchor(image)
    lamp = 4.0 * (np.arange(160.0) - 80.0)  # brighter on the right by 4 grey levels a pixel
    aligned = anchor.align(start, float_image(image) + lamp.astype(np.float32), iterations=20)
    off = np.hypot(*(aligned.warps.current - points).T)
    assert off.max() < 0.03
