"""Many views at once: each is perceived as it would be alone, to the last bit."""

from dataclasses import replace
import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import CAMERA

from visual_servo_epipolar.benchmarks.estimation.scenes import Cell, draw_pair, Pair
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import Estimate, Prior
from visual_servo_epipolar.core.estimators.registry import EACH, estimate, estimates, ESTIMATORS
from visual_servo_epipolar.core.geometry.lens import unknown_lens
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.perception.batch import perceive_each, RobotView
from visual_servo_epipolar.core.perception.memory import fresh_memory
from visual_servo_epipolar.core.perception.observation import Observation, observe, observe_each
from visual_servo_epipolar.core.perception.perceive import perceive
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.tracking.features import Features

CELL = Cell(baseline=3.0, tilt=0.3, jitter=0.1, outliers=0.1, points=30)


def pair_of(seed: int) -> Pair:
    return draw_pair(CELL, np.random.default_rng((1, seed)))


def robot_view(seed: int, *, count: int, estimator: str, known: bool, law: str) -> RobotView:
    """Return a view of ``count`` features, with the bearings of the frame before if known."""
    pair, told = pair_of(seed), ServoSettings(estimator=estimator, law=law, seed=seed)
    memory = fresh_memory(told)
    if known:
        off = math.radians(0.5)
        before = replace(pair.bearings, psi=pair.bearings.psi + off)
        memory = replace(memory, bearings=before)
    seen = Observation(seed, pair.current[:count], pair.desired[:count], 769.0)
    return RobotView(seen, told, seed, memory)


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
def test_company_changes_nothing(seen: list[RobotView]) -> None:
    # By text, as what could not be seen is nan; every digit counts.
    assert [repr(it) for it in perceive_each(seen)] == [repr(perceive(*it)) for it in seen]


def test_more_views_than_a_stack_holds_are_perceived_in_their_order() -> None:
    seen = [
        robot_view(k, count=30, estimator='planar_2dof', known=True, law='full') for k in range(70)
    ]
    assert [each.measurement.stamp_ns for each in perceive_each(seen)] == list(range(70))


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
        assert isinstance(answer, Estimate)
        assert answer.bearings == alone.bearings
        np.testing.assert_array_equal(answer.fundamental, alone.fundamental)
        np.testing.assert_array_equal(answer.inliers, alone.inliers)


@pytest.mark.parametrize('focal_deviation', [0.0, 1.0])
@pytest.mark.parametrize('name', ESTIMATORS)
def test_one_view_and_many_give_the_same_estimate(name: str, focal_deviation: float) -> None:
    pairs, off = [pair_of(k) for k in range(4)], math.radians(0.5)
    # The second prior does not fit, and the third view has none.
    leaps = [off, 0.8, None, -off]
    bearings = [
        None if leap is None else replace(pair.bearings, psi=pair.bearings.psi + leap)
        for pair, leap in zip(pairs, leaps, strict=True)
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
        # By text: every digit counts.
        assert repr(together[k]) == repr(alone)
        assert (alone.lens_covariance is None) == (not focal_deviation or name != 'soft_planar')


@pytest.mark.parametrize('distortion', [(), (-0.2, 0.05, 0.001, -0.001, 0.01)])
def test_features_of_many_views_are_the_rays_of_each(distortion: tuple[float, ...]) -> None:
    camera, rng = replace(CAMERA, distortion=distortion), np.random.default_rng(4)
    seen = []
    for count in (0, 7, 60):
        pixels = rng.uniform(50.0, 900.0, (2, count, 2))
        ids = np.arange(count)
        seen.append(Features(ids, pixels[0], pixels[1], ids, np.zeros(count)))
    for each, together in zip(seen, observe_each(seen, camera, [3, 4, 5]), strict=True):
        alone = observe(each, camera, together.stamp_ns)
        np.testing.assert_array_equal(together.current, alone.current)
        np.testing.assert_array_equal(together.desired, alone.desired)
        assert (together.focal, together.edges) == (alone.focal, alone.edges)
