"""Whatever images come: the tracker goes on, with features that are finite, or with none."""

from functools import cache

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats

from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.tracking import tracker as module
from visual_servo_epipolar.core.tracking.alignment import Anchor
from visual_servo_epipolar.core.tracking.flow import flow, Frame, OpenCVError
from visual_servo_epipolar.core.tracking.reacquisition import PredictedFeatures, reacquire
from visual_servo_epipolar.core.tracking.robust_geometry import (
    agree_on_one_geometry,
    epipolar_geometry,
)
from visual_servo_epipolar.core.tracking.sampling import float_image, patch_radius
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.core.tracking.warps import Warps

SIZE = (96, 128)  # rows and columns: small, so that many are tried
KINDS = ('scene', 'shifted', 'constant', 'black', 'pepper', 'noise', 'stripes', 'checks', 'edge')
kinds = st.sampled_from(KINDS)
pixels = floats(-1e6, 1e6)
sides = st.integers(1, 40)


@cache
def scene() -> np.ndarray:
    """Return blobs of all greys: what can be tracked."""
    rng = np.random.default_rng(3)
    coarse = rng.integers(0, 256, (SIZE[0] // 4, SIZE[1] // 4))
    return np.kron(coarse, np.ones((4, 4))).astype(np.uint8)


def image(kind: str, seed: int = 0, shape: tuple[int, int] = SIZE) -> np.ndarray:
    rng = np.random.default_rng(seed)
    rows, columns = np.indices(shape)
    if kind in ('scene', 'shifted') and shape == SIZE:
        return np.roll(scene(), int(rng.integers(-6, 7)) * (kind == 'shifted'), axis=1)
    if kind == 'pepper':
        return rng.choice(np.array([0, 255], np.uint8), shape)
    if kind == 'noise':
        return rng.integers(0, 256, shape).astype(np.uint8)
    grey = {
        'black': 0 * rows,
        'stripes': 255 * (columns % 2),
        'checks': 255 * ((rows + columns) % 2),
        'edge': 255 * (columns > shape[1] // 2),
    }
    return grey.get(kind, 0 * rows + 90).astype(np.uint8)


def assert_sound(features) -> None:
    for column in (features.current, features.desired, features.errors):
        assert np.isfinite(column).all()


@settings(max_examples=12, deadline=None)
@given(
    stream=st.lists(st.tuples(kinds, st.integers(0, 99)), min_size=1, max_size=5),
    period=st.sampled_from([0, 1, 2]),
    correlation=st.sampled_from([0.0, 0.85]),
)
def test_any_stream_of_images_is_survived(stream, period, correlation) -> None:
    tracking = Tracker(
        TrackerSettings(anchor_period=period, min_correlation=correlation, rematch_period=1)
    )
    tracking.set_desired(scene())
    for kind, seed in stream:
        assert_sound(tracking.track(image(kind, seed)))
    tracking.redetect()
    assert len(tracking.track(scene())) >= 8  # nothing of it is remembered


@settings(max_examples=60, deadline=None)
@given(kind=kinds, height=sides, width=sides, seed=st.integers(0, 99))
def test_a_photograph_of_any_size_is_a_view_or_refused(kind, height, width, seed) -> None:
    picture = image(kind, seed, (height, width))
    tracking = Tracker(TrackerSettings())
    try:
        tracking.set_desired(picture)
    except TrackingError as error:
        assert 'take the photograph where there is texture' in str(error)
        return
    assert_sound(tracking.track(picture))


@pytest.mark.parametrize('shape', [(1, 128), (96, 1), (16, 16), (480, 640)])
def test_another_size_in_mid_run_is_refused_and_forgiven(shape: tuple[int, int]) -> None:
    tracking = Tracker(TrackerSettings())
    tracking.set_desired(scene())
    found = len(tracking.track(scene()))
    with pytest.raises(ValueError, match='image must have the size of the desired one, 128x96'):
        tracking.track(np.full(shape, 9, np.uint8))
    assert len(tracking.track(scene())) == found >= 8


@settings(max_examples=60, deadline=None)
@given(
    rows=st.lists(st.tuples(*[st.one_of(pixels, st.sampled_from([5.0, 7.0]))] * 4), max_size=14),
    repeated=st.booleans(),
)
def test_any_matches_have_a_geometry_or_none(rows: list, repeated: bool) -> None:
    table = np.array(rows or np.empty((0, 4)), dtype=np.float64).reshape(-1, 4)
    table = np.concatenate([table, table]) if repeated else table
    geometry, inliers = epipolar_geometry(table[:, :2], table[:, 2:])
    assert inliers.shape == (len(table),)
    assert geometry is None or np.isfinite(geometry).all()
    assert isinstance(agree_on_one_geometry(table[:, :2], table[:, 2:]), bool)


@settings(max_examples=60, deadline=None)
@given(
    kind=kinds,
    places=st.lists(st.tuples(pixels, pixels, pixels, pixels), min_size=1, max_size=9),
    affine=st.tuples(*[floats(-1e4, 1e4)] * 4),
)
def test_alignment_and_search_end_for_any_warp(kind: str, places: list, affine: tuple) -> None:
    table, count = np.array(places), len(places)
    local = np.tile(np.reshape(affine, (2, 2)), (count, 1, 1))
    warps = Warps(np.arange(count), table[:, :2] % 128.0, table[:, 2:], local)
    anchor, current = Anchor(scene()), float_image(image(kind))
    alignment = anchor.align(warps, current, iterations=15)
    assert np.isfinite(alignment.warps.current).all()
    assert np.isfinite(alignment.warps.affine).all()
    assert np.isfinite(alignment.correlation).all()
    for unseen in (0, 1000):  # by the last position, and by the neighbours
        predicted = PredictedFeatures(warps, np.full(count, unseen))
        assert np.isfinite(reacquire(predicted, warps, anchor, current).current).all()


@pytest.mark.parametrize('kind', ['stripes', 'checks'])
def test_contrast_without_a_slope_stays_where_it_is(kind: str) -> None:
    picture, place = image(kind), np.full((1, 2), 40.0)
    for off in (0.0, 0.3):
        start = Warps(np.zeros(1, int), place, place + off, np.eye(2)[None])
        aligned = Anchor(picture).align(start, float_image(picture), iterations=4).warps
        assert np.isfinite(aligned.current).all()


def test_the_flow_of_no_point_is_none() -> None:
    frame, nothing = Frame(scene()), np.empty((0, 2), np.float32)
    moved, valid = flow(frame, frame, nothing, settings=TrackerSettings())
    assert (len(moved), len(valid)) == (0, 0)


def test_what_opencv_cannot_do_is_a_reason_and_the_next_image_is_tracked(monkeypatch) -> None:
    tracking = Tracker(TrackerSettings())
    tracking.set_desired(scene())
    usual = len(tracking.track(scene()))

    def fails(*_: object, **__: object) -> None:
        raise OpenCVError('(-215:Assertion failed) !model.empty()')

    with monkeypatch.context() as patched:
        patched.setattr(module, 'flow', fails)
        assert len(tracking.track(scene())) == 0
    assert tracking.reason.startswith('the image could not be tracked in: (-215')
    assert len(tracking.track(scene())) == usual
    assert tracking.reason == ''


@pytest.mark.parametrize(
    ('shape', 'radius'),
    [((1024, 1280), 10), ((480, 640), 10), ((1080, 1920), 10), ((256, 320), 6), ((16, 16), 6)],
)
def test_patches_shrink_with_small_images_alone(shape: tuple[int, int], radius: int) -> None:
    assert patch_radius(shape) == radius
