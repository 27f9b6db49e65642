"""What is left out of a frame's work: it changes nothing, and it is left out."""

import cv2
import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import are_among
from visual_servo_epipolar.core.tracking import alignment
from visual_servo_epipolar.core.tracking.alignment import Anchor, LEVELS, Templates
from visual_servo_epipolar.core.tracking.candidates import Candidates, FULL_PERIOD, TRIES
from visual_servo_epipolar.core.tracking.flow import flow, Frame
from visual_servo_epipolar.core.tracking.matching import desired_view
from visual_servo_epipolar.core.tracking.robust_geometry import agree_on_one_geometry
from visual_servo_epipolar.core.tracking.sampling import float_image, PatchGrid
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.warps import Warps

SHIFT = np.array([1.6, -0.7])  # px


def scene(shift: np.ndarray | None = None, size: tuple[int, int] = (640, 480)) -> np.ndarray:
    """Return smooth blobs of all greys of a ``size``, moved by ``shift``."""
    noise = np.random.default_rng(5).uniform(0.0, 255.0, size[::-1])
    image = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 3.0), None, 20.0, 235.0, cv2.NORM_MINMAX)
    if shift is not None:
        matrix = np.column_stack([np.eye(2), shift])
        image = cv2.warpAffine(image, matrix, size, borderMode=cv2.BORDER_REFLECT)
    return image.astype(np.uint8)


def grid() -> np.ndarray:
    """Return 48 pixels, shape (48, 2), away from the border."""
    columns, rows = np.meshgrid(np.linspace(40, 280, 8), np.linspace(40, 200, 6))
    return np.column_stack([columns.ravel(), rows.ravel()])


def warps(offset: np.ndarray, first: int = 0, desired: np.ndarray | None = None) -> Warps:
    desired = grid() if desired is None else desired
    ids, affine = first + np.arange(len(desired)), np.tile(np.eye(2), (len(desired), 1, 1))
    return Warps(ids, desired, desired + offset, affine)


def test_the_coarse_flow_is_near_enough_to_be_aligned() -> None:
    frames, settings = (Frame(scene()), Frame(scene(SHIFT))), TrackerSettings()
    points = grid().astype(np.float32)
    fine, _ = flow(*frames, points, settings=settings)
    coarse, valid = flow(*frames, points, settings=settings, coarse=True)
    assert valid.all()
    assert 0.0 < np.abs(coarse - fine).max() < 0.5
    assert frames[1].half is frames[1].half
    assert 'half' not in vars(Frame(scene()))


@pytest.mark.parametrize(('levels', 'size'), [(0, (640, 480)), (3, (320, 240))])
def test_without_levels_the_flow_is_that_of_the_whole_image(levels, size) -> None:
    frames = Frame(scene(size=size)), Frame(scene(SHIFT, size))
    settings = TrackerSettings(levels=levels)
    points = grid().astype(np.float32)
    fine, _ = flow(*frames, points, settings=settings)
    coarse, _ = flow(*frames, points, settings=settings, coarse=True)
    np.testing.assert_array_equal(coarse, fine)


@pytest.mark.parametrize(('error', 'agree'), [(0.0, True), (12.0, False), (np.nan, False)])
def test_all_agree_unless_one_does_not(error: float, agree: bool) -> None:
    rng = np.random.default_rng(2)
    desired = rng.uniform(0.0, 640.0, (40, 2))
    current = 320.0 + (desired - 320.0) / rng.uniform(1.1, 1.6, (40, 1))  # driving ahead
    across = np.array([-(desired[7, 1] - 320.0), desired[7, 0] - 320.0])
    current[7] += error * across / np.hypot(*across)
    assert agree_on_one_geometry(current, desired) == agree


def test_with_enough_tracked_the_search_rests_in_most_frames() -> None:
    view = desired_view(scene())
    candidates, nothing = Candidates(view), Warps.empty()
    candidates.remember(np.arange(len(view.keypoints)), 100)
    sought = [len(candidates.next_missing(nothing, 8, 0)) for _ in range(2 * FULL_PERIOD)]
    assert [bool(count) for count in sought] == [False, False, True] * 2
    assert all(len(candidates.next_missing(nothing, 8, 60)) == 8 for _ in range(3))


def test_what_few_features_are_missed_is_looked_for_in_several_frames() -> None:
    view = desired_view(scene())
    candidates, nothing = Candidates(view), Warps.empty()
    candidates.remember(np.arange(len(view.keypoints)), 100)

    def sought(enough: int, count: int = 8) -> int:
        return len(candidates.next_missing(nothing, count, enough))

    assert [sought(1) for _ in range(4)] == [TRIES] * 4  # one is missing, again and again
    assert sought(2) == 2 * TRIES
    # One was missing: the eight that are due for it are tried, though none is any more.
    assert [sought(1), sought(0), sought(0)] == [TRIES, TRIES, 8 - 2 * TRIES]
    assert sum(sought(0) > 0 for _ in range(2 * FULL_PERIOD)) == 2
    assert [sought(1), sought(0, count=1), sought(60, count=0)] == [TRIES, 1, 0]


def test_ids_are_contained_or_not() -> None:
    rng = np.random.default_rng(1)
    ids, among = rng.integers(0, 50, 30), rng.integers(0, 80, 20)
    np.testing.assert_array_equal(are_among(ids, among), np.isin(ids, among))
    assert not are_among(ids, among[:0]).any()
    assert are_among(ids[:0], among).shape == (0,)


MOST, COUNT = 48, 20


@pytest.fixture
def cache(monkeypatch) -> Templates:
    monkeypatch.setattr(alignment, 'MOST', MOST)
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


def test_light_that_grows_across_a_patch_is_no_motion() -> None:
    texture = np.random.default_rng(1).normal(size=(120, 160))
    image = cv2.GaussianBlur(texture, (0, 0), 3.0)
    image = (110.0 + 40.0 * image / image.std()).clip(0, 255).astype(np.uint8)
    points = np.stack(np.meshgrid([40.0, 80.0, 120.0], [40.0, 80.0]), axis=-1).reshape(-1, 2)
    start, anchor = warps(np.array([0.3, 0.3]), desired=points), Anchor(image)
    lamp = 4.0 * (np.arange(160.0) - 80.0)  # brighter on the right by 4 grey levels a pixel
    aligned = anchor.align(start, float_image(image) + lamp.astype(np.float32), iterations=20)
    off = np.hypot(*(aligned.warps.current - points).T)
    assert off.max() < 0.03
