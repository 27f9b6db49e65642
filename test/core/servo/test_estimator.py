"""Two views are not estimated where the memory of views knows better."""

from dataclasses import replace

import numpy as np
import pytest
from servo_states import MEMORY, reading, sight

from visual_servo_epipolar.commands.arguments import scenario_path
from visual_servo_epipolar.core.estimate.map_state import MapState, measurement_of
from visual_servo_epipolar.core.goal import Goal
from visual_servo_epipolar.core.mapping.keyframe_map import KeyframeMap
from visual_servo_epipolar.core.servo import estimator
from visual_servo_epipolar.core.servo.estimator import SKIPPED, two_view_skip
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import step
from visual_servo_epipolar.core.twoview import validation
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.perceive import perceive, with_difference
from visual_servo_epipolar.simulation.scenario import load
from visual_servo_epipolar.simulation.views import drive

START, SEED = (-0.9, -3.0, 8.0), 4
VIEWS = MapState(KeyframeMap(ServoSettings().mount))
Driven = list[tuple[ServoState, Observation, ServoSettings]]


@pytest.fixture(scope='module')
def driven() -> Driven:
    """The first 120 steps of a run: each state, and what was seen in it."""
    scenario = load(scenario_path('nominal')).seeded(SEED)
    steps: Driven = []

    def control(state: ServoState, seen: Observation, servo: ServoSettings) -> ServoState:
        steps.append((state, seen, servo))
        return step(state, seen, servo)

    drive(scenario, START, SEED, control=control)
    return steps[:120]


def first_spared(steps: Driven) -> tuple[ServoState, Observation, ServoSettings]:
    """Return the first step whose perception skips two views."""
    return next(
        each for each in steps if each[0].view.memory and each[0].view.memory.two_view_skip
    )


def test_one_view_of_four_is_estimated_once_the_memory_knows(driven, monkeypatch) -> None:
    estimated = 0
    estimate = validation.estimate

    def counted(*args: object, **keywords: object) -> object:
        nonlocal estimated
        estimated += 1
        return estimate(*args, **keywords)

    monkeypatch.setattr(validation, 'estimate', counted)
    known = [each for each in driven if each[0].measurement and each[0].measurement.remembered]
    assert len(known) > 40
    for state, seen, servo in known:
        step(state, seen, servo)
    assert estimated == pytest.approx(len(known) / (SKIPPED + 1), abs=2)


def test_where_the_memory_fails_two_views_are_estimated_at_once(driven) -> None:
    state, seen, servo = first_spared(driven)
    assert perceive(seen, servo, state.view.frame, state.view.memory).measurement.bearings is None
    after = step(state.changed(goal=Goal()), seen, servo)
    assert after.measurement.bearings is not None
    assert not after.measurement.remembered
    assert (after.view.memory.two_view_skip, after.view.memory.wrong) == (0, None)


def test_where_the_memory_is_unsure_two_views_are_asked(driven, monkeypatch) -> None:
    """A few of the remembered features in view: they agree, but the bearing is known to 7 deg."""
    state, seen, servo = first_spared(driven)
    localize = estimator.localize

    def unsure(*args: object, **keywords: object) -> object:
        views, read = localize(*args, **keywords)
        deviation = 1.2 * servo.max_deviation * read.distance
        return views, replace(read, covariance=deviation**2 * np.eye(5))

    monkeypatch.setattr(estimator, 'localize', unsure)
    after = step(state, seen, servo)
    assert after.measurement.bearings is not None
    assert after.phase is state.phase
    assert after.view.memory.two_view_skip == 0


def test_wrong_matches_that_the_memory_found_do_not_count_for_the_margins(driven) -> None:
    state, seen, servo = first_spared(driven)
    everything = perceive(seen, servo, state.view.frame, replace(state.view.memory, wrong=()))
    rightmost = np.argsort(np.arctan2(seen.current[:, 0], seen.current[:, 2]))[-20:]
    wrong = tuple(seen.ids[rightmost].tolist())
    without = perceive(seen, servo, state.view.frame, replace(state.view.memory, wrong=wrong))
    assert without.measurement.view_margins != everything.measurement.view_margins


@pytest.mark.parametrize(
    ('measurement', 'read', 'spared'),
    [
        (sight(remembered=True, offset=(0.0, -0.5)), reading(), SKIPPED),
        (sight(bearings=None, offset=(0.0, -0.5)), reading(), SKIPPED),  # too near for either
        (sight(offset=(0.0, -0.5)), reading(), 0),  # two views know better, and are asked
        (sight(), None, 0),
    ],
)
def test_they_are_spared_where_they_do_not_count(measurement, read, spared) -> None:
    assert two_view_skip(MEMORY, measurement, read, VIEWS).two_view_skip == spared
    counting = replace(MEMORY, two_view_skip=1, wrong=(1, 2))
    assert two_view_skip(counting, measurement, read, VIEWS).two_view_skip == 0


def test_the_next_estimate_begins_where_the_memory_is() -> None:
    seen = sight(remembered=True, offset=(0.0, -0.5))
    assert two_view_skip(MEMORY, seen, reading(), VIEWS).bearings == reading().bearings
    near = sight(bearings=None, offset=(0.0, -0.5))
    assert two_view_skip(MEMORY, near, reading(), VIEWS).bearings == MEMORY.bearings


def test_d_is_left_out_where_a_memory_is_expected_to_know_it(driven) -> None:
    state, seen, servo = first_spared(driven)
    found = perceive(seen, servo, state.view.frame, state.view.memory)
    assert np.isnan(found.measurement.difference)
    after = with_difference(found, servo)
    whole = perceive(seen, servo, state.view.frame, replace(state.view.memory, two_view_skip=0))
    # The heading of two views is another than that of the best rotation.
    assert after.difference == pytest.approx(whole.measurement.difference, abs=0.05)
    assert after.difference_deviation == pytest.approx(
        whole.measurement.difference_deviation, rel=0.1
    )
    assert measurement_of(found, None, VIEWS, servo).difference == after.difference
