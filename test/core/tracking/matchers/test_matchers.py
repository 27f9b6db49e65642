"""Each matcher of the registry: deterministic, right in a room, calm where nothing is shown."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.tracking.matchers.base import Matcher
from visual_servo_epipolar.core.tracking.matchers.registry import Loadable, MATCHERS
from visual_servo_epipolar.core.tracking.matching import desired_view, match
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

ROOM = CameraSettings(
    width=320, height=256, focal_length=192.3, principal_u=158.4, principal_v=127.6
)
START = Pose.from_start(0.6, -3.0, 8.0)
WHOLE = {'limit': 1000, 'quick': False}


@cache
def world() -> CameraSimulator:
    return CameraSimulator(ROOM)


def noise(seed: int, shape: tuple[int, int] = (256, 320)) -> Image:
    return np.random.default_rng(seed).integers(0, 256, shape).astype(np.uint8)


# Those that are made of a file are tried in test_onnx.py.
READY = [name for name in MATCHERS if not isinstance(MATCHERS[name], Loadable)]


@pytest.mark.parametrize('name', READY)
def test_it_fulfils_the_protocol_and_says_the_same_twice(name: str) -> None:
    matcher, image = MATCHERS[name], world().capture(START, 0)
    assert isinstance(matcher, Matcher)
    desired = matcher.describe(world().photograph(), limit=1000, border=12.0)
    first, second = (matcher.detect(image, desired.tuning, **WHOLE) for _ in '12')
    pairs = matcher.pairs(desired, first)
    assert pairs.shape[1] == 2
    assert np.array_equal(pairs, matcher.pairs(desired, second))
    assert np.array_equal(first.pixels, second.pixels)


@pytest.mark.parametrize('name', READY)
def test_its_matches_are_where_the_room_says(name: str) -> None:
    view = desired_view(world().photograph(), MATCHERS[name])
    matches = match(view, world().capture(START, 0))
    points = world().renderer.trace(view.keypoints.pixels[matches.indices], DESIRED_POSE)
    truth, _ = world().renderer.project(points, START)
    assert np.median(np.hypot(*(truth - matches.pixels).T)) < 1.0


@pytest.mark.parametrize('name', READY)
@pytest.mark.parametrize('image', [np.full((256, 320), 128, np.uint8), noise(1), noise(2, (3, 9))])
def test_it_never_raises_for_what_an_image_shows(name: str, image: Image) -> None:
    matcher = MATCHERS[name]
    desired = matcher.describe(world().photograph(), limit=1000, border=12.0)
    pairs = matcher.pairs(desired, matcher.detect(image, desired.tuning, **WHOLE))
    assert pairs.shape[1] == 2
    matcher.describe(image, limit=1000, border=12.0)


def test_a_matcher_without_sizes_and_angles_will_do() -> None:
    class Upright:
        def describe(self, image, *, limit, border):
            return plain(MATCHERS['sift'].describe(image, limit=limit, border=border))

        def detect(self, image, tuning, *, limit, quick):
            return plain(MATCHERS['sift'].detect(image, tuning, limit=limit, quick=quick))

        def pairs(self, desired, current):
            return MATCHERS['sift'].pairs(desired, current)

    def plain(keypoints):
        ones = np.ones(len(keypoints))
        return replace(keypoints, sizes=ones, angles=0.0 * ones)

    photograph, image = world().photograph(), world().capture(START, 0)
    matches = match(desired_view(photograph, Upright()), image)
    assert len(matches.indices) >= 12
    told = match(desired_view(photograph), image)
    # By the distances between matches, as SIFT has it by sizes.
    assert np.median(matches.scales) == pytest.approx(np.median(told.scales), rel=0.1)


def test_a_matcher_that_nobody_has_is_named() -> None:
    with pytest.raises(ValueError, match="matcher must be one of sift.*, got 'loftr'"):
        TrackerSettings(matcher='loftr')


def test_the_tracker_uses_the_matcher_that_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    class Spy:
        def describe(self, image, *, limit, border):
            asked.append('describe')
            return MATCHERS['sift'].describe(image, limit=limit, border=border)

        def detect(self, image, tuning, *, limit, quick):
            asked.append('detect')
            return MATCHERS['sift'].detect(image, tuning, limit=limit, quick=quick)

        def pairs(self, desired, current):
            asked.append('pairs')
            return MATCHERS['sift'].pairs(desired, current)

    monkeypatch.setitem(MATCHERS._loaded, 'spy', Spy())
    tracker = Tracker(replace(TrackerSettings(), matcher='spy'))
    tracker.set_desired(world().photograph())
    assert len(tracker.track(world().capture(START, 0))) >= 40
    assert asked == ['describe', 'detect', 'pairs']
