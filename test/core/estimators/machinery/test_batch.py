"""Many views at once: each is perceived as it would be alone, to the last bit."""

from dataclasses import replace
import math
import sys

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import CAMERA

from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import Prior
from visual_servo_epipolar.core.estimators.registry import EACH, estimate, estimates, ESTIMATORS
from visual_servo_epipolar.core.geometry.lens import unknown_lens
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.perception.batch import perceive_each, RobotView
from visual_servo_epipolar.core.perception.memory import fresh_memory
from visual_servo_epipolar.core.perception.observation import Observation, observe, observe_each
from visual_servo_epipolar.core.perception.perceive import perceive
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.evaluation.benchmarks.estimation.scenes import Cell, draw_pair, Pair

CELL = Cell(baseline=3.0, tilt=0.3, jitter=0.1, outliers=0.1, points=30)


def every_digit(value: object) -> str:
    """Return ``value`` as text that tells any two floats apart, within arrays too."""
    with np.printoptions(floatmode='unique', threshold=sys.maxsize):
        return repr(value)


def pair_of(seed: int) -> Pair:
    return draw_pair(CELL, np.random.default_rng((1, seed)))


def robot_view(seed: int, *, count: int, estimator: str, known: bool, law: str) -> RobotView:
    """Return a view of ``count`` features, with the bearings of the frame before if known."""
    pair, servo = pair_of(seed), ServoSettings(estimator=estimator, law=law, seed=seed)
    memory = fresh_memory(servo)
    if known:
        off = math.radians(0.5)
        before = replace(pair.bearings, psi=pair.bearings.psi + off)
        memory = replace(memory, bearings=before)
    observation = Observation(seed, pair.current[:count], pair.desired[:count], 769.0)
    return RobotView(observation, servo, seed, memory)


def robot_views() -> st.SearchStrategy[RobotView]:
    return st.builds(
        robot_view,
        st.integers(0, 30),
        count=st.sampled_from([5, 20, 30]),
        estimator=st.sampled_from(['soft_planar', 'soft_planar', 'planar_2dof', 'planar_3dof']),
        known=st.booleans(),
        law=st.sampled_from(['full', 'corrected']),
    )


@settings(max_examples=30)
@given(st.lists(robot_views(), max_size=9))
def test_company_changes_nothing(views: list[RobotView]) -> None:
    # By text, as what could not be measured is nan.
    together = [every_digit(perception) for perception in perceive_each(views)]
    assert together == [every_digit(perceive(*view)) for view in views]


def test_arrays_that_differ_in_the_last_bit_differ_as_text() -> None:
    estimate = ESTIMATORS['planar_2dof'](
        pair_of(0).current,
        pair_of(0).desired,
        noise=pair_of(0).noise,
        prior=Prior(),
        rng=np.random.default_rng(0),
    )
    nudged = np.nextafter(estimate.fundamental, np.inf)
    assert every_digit(replace(estimate, fundamental=nudged)) != every_digit(estimate)


def test_more_views_than_a_stack_holds_are_perceived_in_their_order() -> None:
    views = [
        robot_view(k, count=30, estimator='planar_2dof', known=True, law='full') for k in range(70)
    ]
    assert [each.measurement.stamp_ns for each in perceive_each(views)] == list(range(70))


@pytest.mark.parametrize('name', EACH)
def test_a_view_that_cannot_answer_does_not_silence_the_others(name: str) -> None:
    pairs = [pair_of(k) for k in range(3)]
    current = np.array([pair.current for pair in pairs])
    desired = np.array([pair.desired for pair in pairs])
    for rays in (current, desired):  # all on the horizon
        rays[1] = normalised(rays[1] * [1.0, 0.0, 1.0])
    answers = estimates(
        name,
        current,
        desired,
        noise=np.array([pair.noise for pair in pairs]),
        priors=[Prior(bearings=pair.bearings) for pair in pairs],
        seeds=[(0, 0)] * 3,
    )
    assert isinstance(answers[1], DegenerateGeometryError)
    for k in (0, 2):
        answer, pair = answers[k], pairs[k]
        alone = ESTIMATORS[name](
            pair.current,
            pair.desired,
            noise=pair.noise,
            prior=Prior(bearings=pair.bearings),
            rng=np.random.default_rng(0),
        )
        assert every_digit(answer) == every_digit(alone)


@pytest.mark.parametrize('focal_deviation', [0.0, 1.0])
@pytest.mark.parametrize('name', ESTIMATORS)
def test_one_view_and_many_give_the_same_estimate(name: str, focal_deviation: float) -> None:
    pairs, off = [pair_of(k) for k in range(4)], math.radians(0.5)
    # The second prior does not fit, and the third view has none.
    offsets = [off, 0.8, None, -off]
    bearings = [
        None if offset is None else replace(pair.bearings, psi=pair.bearings.psi + offset)
        for pair, offset in zip(pairs, offsets, strict=True)
    ]
    priors = [Prior(bearings=each, lens=unknown_lens(focal_deviation)) for each in bearings]
    together = estimates(
        name,
        np.array([pair.current for pair in pairs]),
        np.array([pair.desired for pair in pairs]),
        noise=np.array([pair.noise for pair in pairs]),
        priors=priors,
        seeds=[(3, k) for k in range(4)],
    )
    for k, (pair, prior) in enumerate(zip(pairs, priors, strict=True)):
        alone = estimate(
            name, pair.current, pair.desired, noise=pair.noise, prior=prior, seed=(3, k)
        )
        assert every_digit(together[k]) == every_digit(alone)
        assert (alone.lens_covariance is None) == (not focal_deviation or name != 'soft_planar')


@pytest.mark.parametrize('distortion', [(), (-0.2, 0.05, 0.001, -0.001, 0.01)])
def test_features_of_many_views_are_the_rays_of_each(distortion: tuple[float, ...]) -> None:
    camera, rng = replace(CAMERA, distortion=distortion), np.random.default_rng(4)
    views, stamps_ns = [], [3, 4, 5]
    for count in (0, 7, 60):
        pixels = rng.uniform(50.0, 900.0, (2, count, 2))
        ids = np.arange(count)
        views.append(Features(ids, pixels[0], pixels[1], ids, np.zeros(count)))
    together = observe_each(views, camera, stamps_ns)
    alone = [observe(view, camera, stamp) for view, stamp in zip(views, stamps_ns, strict=True)]
    assert [every_digit(each) for each in together] == [every_digit(each) for each in alone]
    assert [each.stamp_ns for each in alone] == stamps_ns
    assert all(each.pixel_angles is not None for each in together)
