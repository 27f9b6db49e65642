"""From matches to a Measurement: what is measured, and what is said when it cannot be."""

from dataclasses import replace
import math
import pickle

from durations import few_of
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from sequences import driven, DRIVES, error_deg
from strategies import blurred, CAMERA, floats, matches, panorama

from visual_servo_epipolar.core.geometry.epipolar import Bearings, rotation_desired_current
from visual_servo_epipolar.core.geometry.lens import Lens
from visual_servo_epipolar.core.geometry.motion import HALF_PI, Pose
from visual_servo_epipolar.core.geometry.rays import LEAST_FORWARD, normalised, unit_rays
from visual_servo_epipolar.core.geometry.rotation import fit_rotation
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.twoview import perceive as perceiving
from visual_servo_epipolar.core.twoview.measurement import (
    difference_deviation,
    feature_difference,
    Measurement,
    view_margins,
)
from visual_servo_epipolar.core.twoview.memory import fresh_memory, PerceptionMemory
from visual_servo_epipolar.core.twoview.observation import Observation, observe
from visual_servo_epipolar.core.twoview.perceive import perceive
from visual_servo_epipolar.core.twoview.registry import ESTIMATORS
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings
from visual_servo_epipolar.core.twoview.validation import angular_extent, innovation

SETTINGS = ServoSettings()
BEHIND = Pose(1.0, -3.0, HALF_PI)


def observation(current: np.ndarray, desired: np.ndarray) -> Observation:
    return Observation(0, current, desired, 769.0)


def measured(seen: Observation, settings: ServoSettings = SETTINGS) -> Measurement:
    return perceive(seen, settings, 0).measurement


@given(floats(-0.5, 0.5))
def test_a_pure_rotation_has_a_heading_but_no_bearings(alpha: float) -> None:
    measurement = measured(observation(*matches(Pose(0.0, 0.0, HALF_PI + alpha))))
    assert measurement.bearings is None
    assert measurement.heading_error == pytest.approx(alpha, abs=1e-12)
    assert 'parallax of 0.00 px is too small' in measurement.reason


def test_d_of_a_pure_rotation_is_zero_only_if_compensated() -> None:
    current, desired = matches(Pose(0.0, 0.0, HALF_PI + 0.1))
    seen = observation(current, desired)
    assert measured(seen).difference == pytest.approx(0.0, abs=1e-12)
    without = measured(seen, ServoSettings(law='corrected')).difference
    assert without == pytest.approx(feature_difference(current, desired))
    assert abs(without) > 1e-3


def test_one_feature_less_than_needed_is_too_few() -> None:
    current, desired = matches(BEHIND)
    least = SETTINGS.min_features
    few, enough = (measured(observation(current[:n], desired[:n])) for n in (least - 1, least))
    assert (few.bearings, few.reason) == (None, f'{least - 1} features, {least} needed')
    assert enough.bearings


def noisy(pose: Pose = BEHIND) -> Observation:
    """Return matches with a noise of 0.8 px."""
    current, desired = matches(pose)
    return observation(blurred(current, 1e-3, np.random.default_rng(0)), desired)


def test_a_vote_that_is_not_clear_enough_is_not_trusted() -> None:
    near = Pose(0.02, -0.1, HALF_PI)  # the far features have less parallax than noise
    measurement = measured(noisy(near), ServoSettings(min_confidence=1.0))
    assert 0.0 < measurement.confidence < 1.0
    assert measurement.bearings is None
    assert 'cheirality vote is undecided (0.' in measurement.reason


@pytest.mark.parametrize('estimator', ['lmeds_8pt', 'soft_planar'])
def test_a_perception_is_fixed_by_seed_and_frame(estimator: str) -> None:
    settings = ServoSettings(estimator=estimator, seed=3)
    first, again = (perceive(noisy(), settings, 4) for _ in range(2))
    assert pickle.dumps(first) == pickle.dumps(again)
    others = perceive(noisy(), settings, 5), perceive(noisy(), replace(settings, seed=2), 4)
    draws = estimator == 'lmeds_8pt'
    for other in others:
        assert (other.measurement.bearings != first.measurement.bearings) == draws


GARBAGE = 'behind|all round|random|rows|columns|points|equal|huge|line|mirrored'.split('|')


def garbage(kind: str, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return 30 finite matches that no camera would give."""
    rng = np.random.default_rng(seed)
    current, desired = rng.random((2, 30, 2)) - 0.5  # on the image plane
    if kind == 'rows':
        current[:, 1] = desired[:, 1] = 0.1
    elif kind == 'columns':
        current[:, 0], desired[:, 0] = 0.1, 0.2
    elif kind == 'points':
        current[:], desired[:] = 0.1, 0.2
    elif kind == 'equal':
        current = desired.copy()
    elif kind == 'huge':
        current, desired = 1e6 * current, 1e6 * desired
    elif kind == 'line':
        current[:, 1], desired[:, 1] = current[:, 0], 2.0 * desired[:, 0]
    elif kind == 'mirrored':
        current = -desired
    elif kind in ('behind', 'all round'):
        rays = normalised(rng.standard_normal((2, 30, 3)))
        if kind == 'behind':
            rays[..., 2] = -abs(rays[..., 2])
        return rays[0], rays[1]
    return unit_rays(current), unit_rays(desired)


@pytest.mark.parametrize('estimator', ESTIMATORS)
@given(kind=st.sampled_from(GARBAGE), seed=st.integers(0, 1000), known=st.booleans())
def test_garbage_is_never_an_error(estimator: str, kind: str, seed: int, known: bool) -> None:
    settings = ServoSettings(estimator=estimator)
    memory = fresh_memory(settings)
    if known:
        memory = replace(memory, bearings=Bearings(-1.5, 3.0))
    measurement = perceive(observation(*garbage(kind, seed)), settings, 0, memory).measurement
    assert (measurement.bearings is None) == bool(measurement.reason)


def followed(noise: float, frames: int = 60) -> PerceptionMemory:
    """Return what is remembered after frames of one pose, blurred by ``noise`` [px]."""
    current, desired = matches(BEHIND)
    memory = None
    for frame in range(frames):
        rng = np.random.default_rng(frame)
        pixels = (CAMERA.pixels(rays) for rays in (current, desired))
        views = [CAMERA.rays(p + noise * rng.standard_normal(p.shape)) for p in pixels]
        memory = perceive(observation(*views), SETTINGS, frame, memory).memory
    assert memory is not None
    return memory


@pytest.mark.parametrize('noise', [0.15, 0.3, 0.6])
def test_the_noise_is_learnt_from_the_residuals(noise: float) -> None:
    # The median of 40 residuals is 15 % uncertain; of the last ten frames, 5 %.
    assert followed(noise).noise == pytest.approx(noise, rel=0.25)


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'current': np.array([[1.0, np.nan]])}, 'current must be finite, got 1 rows'),
        ({'ages': []}, 'ages must have 1 rows to match ids, got 0'),
    ],
)
def test_features_are_finite_of_equal_length_and_never_change(change, words) -> None:
    pixels = np.zeros((1, 2))
    values = {'ids': [1], 'current': pixels, 'desired': pixels, 'ages': [1], 'errors': [0.0]}
    with pytest.raises(ValueError, match=words):
        Features(**values | change)
    features = Features(**values)
    pixels[0, 0] = 9.0
    assert features.current[0, 0] == 0.0
    with pytest.raises(ValueError, match='read-only'):
        features.current[0, 0] = 1.0


def test_features_all_round_are_perceived_as_those_in_front() -> None:
    # What a panoramic camera or a pan head sees: most rays point behind.
    current, desired = panorama(BEHIND, count=60)
    assert (current[:, 2] < 0.0).sum() > 15
    measurement = measured(observation(current, desired))
    true = Bearings.from_pose(BEHIND)
    assert measurement.bearings is not None
    assert innovation(measurement.bearings, true) < 1e-3
    assert measurement.inliers == 60
    assert measurement.difference < 0.0  # short of the goal


def test_the_deviation_of_d_is_that_of_the_features_it_is_taken_over() -> None:
    rng = np.random.default_rng(5)
    _, desired = panorama(BEHIND, count=60)
    front = desired[:, 2] > LEAST_FORWARD
    assert 10 < front.sum() < 50
    values = []
    for _ in range(400):
        points = desired[front, :2] / desired[front, 2:]
        both = desired.copy(), desired.copy()
        for view in both:
            view[front] = unit_rays(points + 1e-3 * rng.standard_normal(points.shape))
        values.append(float(feature_difference(*both)))
    stated = float(difference_deviation(desired, desired, 1e-3))
    assert np.std(values) == pytest.approx(stated, rel=0.15)


def test_a_camera_that_sees_all_round_may_turn_without_end() -> None:
    current, _ = panorama(BEHIND, count=30)
    everything = np.ones(30, bool)
    assert view_margins(current, everything, (-math.pi, math.pi), 20) == (math.inf, math.inf)


@pytest.mark.parametrize('turn', [0.0, 1.0, 2.0, math.pi])
def test_a_cluster_is_as_small_wherever_it_is(turn: float) -> None:
    cluster = unit_rays(0.01 * (np.random.default_rng(3).random((30, 2)) - 0.5))
    extent = angular_extent(cluster @ rotation_desired_current(turn).T, np.ones(30, bool))
    assert extent == pytest.approx(float(angular_extent(cluster, np.ones(30, bool))), rel=1e-6)
    assert 0.002 < extent < 0.004


@pytest.mark.parametrize('edge', [0.6, 1.6, 2.5, math.pi])
def test_edges_of_the_image_are_corrected_as_rays_are(edge: float) -> None:
    lens = Lens(log_ratio=0.2, shift=0.01)
    ray = np.array([[math.sin(edge), 0.0, math.cos(edge)]])
    seen = Observation(0, ray, ray, 500.0, edges=(-edge, edge), pixel_angles=np.ones((1, 2)))
    after = seen.corrected(lens)
    expected = math.atan2(after.current[0, 0], after.current[0, 2])
    assert after.edges[1] == pytest.approx(math.pi if edge == math.pi else expected)


@pytest.mark.parametrize(('turned', 'trusted'), [(0.0, True), (math.pi, False)])
def test_a_geometry_at_odds_with_the_features_is_not_trusted(turned, trusted, monkeypatch) -> None:
    """In mirrored images one is found by chance now and then."""
    seen = noisy(Pose(0.3, -2.0, HALF_PI + 0.1))
    fit = fit_rotation(seen.current, seen.desired)
    wrong = replace(fit, heading_error=fit.heading_error + turned)
    monkeypatch.setattr(perceiving, 'fit_rotation', lambda *_: wrong)
    measurement = perceive(seen, ServoSettings(), 0).measurement
    assert (measurement.bearings is not None) is trusted
    assert ('the features as a whole' in measurement.reason) is not trusted


@pytest.mark.parametrize(('apart', 'shared'), [(100.0, 1.0), (0.0, 30.0)])
def test_features_whose_patches_overlap_make_bearings_as_much_less_certain(apart, shared) -> None:
    """That there is a direction they show one by one all the same."""
    pixels = 100.0 + apart * np.stack(np.divmod(np.arange(30.0), 6.0), axis=1)
    nothing = np.zeros(30, np.int64)
    features = Features(np.arange(30), pixels, pixels, nothing, np.zeros(30))
    assert observe(features, CAMERA, 0).shared == pytest.approx(shared)
    rng = np.random.default_rng(0)
    seen = observation(*(blurred(rays, 0.3 / 769.0, rng) for rays in matches(BEHIND)))
    alone, limit = measured(seen).deviation, SETTINGS.max_deviation
    for many in (shared, (1.5 * limit / alone) ** 2):
        together = measured(replace(seen, shared=many))
        assert together.bearings is not None
        assert together.deviation == pytest.approx(math.sqrt(many) * alone)


@pytest.mark.parametrize(
    ('kind', 'trusted', 'largest'),
    # Look-alikes are dropped by their depths: 0.5 are trusted where they vote against the others.
    [
        ('alike', 0.8, 2.0),
        *few_of(
            [(kind, 0.5, 10.0) for kind in ('few', 'huddled', 'elsewhere', 'noisy')], keep=(0, 1)
        ),
    ],
)
def test_few_features_or_wrong_ones_mislead_nobody(kind: str, trusted, largest) -> None:
    seen = [it for k in range(3) for it in driven(DRIVES[kind], (3, k), PerceptionSettings())]
    errors = [error_deg(true, found.bearings) for true, found in seen if found.bearings]
    assert len(errors) > trusted * len(seen)
    assert max(errors) < largest
    assert np.percentile(errors, 95) < 4.0


@pytest.mark.parametrize(
    ('kind', 'seed'), [('few', 18), ('elsewhere', 16), ('elsewhere', 6), ('noisy', 11)]
)
def test_a_match_with_which_none_other_agrees_makes_no_bearing_certain(kind, seed) -> None:
    """
    An epipole came to lie on one wrong match, or between its images: 2.7 deg off, 0.1 said.

    By leverage and by depths errors are at most 2.8 deviations in 96 % of the frames; without the
    one 11 to 19 on three of these drives, without the other 5.8 on one.
    """
    seen = list(driven(DRIVES[kind], (7, seed), PerceptionSettings()))
    normalised = [
        error_deg(true, found.bearings) / np.degrees(found.deviation)
        for true, found in seen
        if found.bearings
    ]
    assert len(normalised) > 0.7 * len(seen)
    assert np.percentile(normalised, 95) < 3.0
    assert max(normalised) < 4.5
