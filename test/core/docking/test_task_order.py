"""Answers, phases and currents that come out of their order: none counts in another step."""

import math

import pytest

from visual_servo_epipolar.core.docking.settings import DockTaskSettings
from visual_servo_epipolar.core.docking.task import (
    answered,
    canceled,
    charging,
    elapsed,
    Error,
    Order,
    passed,
    Request,
    requested,
    said,
    Step,
    Task,
)
from visual_servo_epipolar.core.laws.phase import Phase

SETTINGS = DockTaskSettings(max_retries=1)
CHARGING = DockTaskSettings(wait_for_charge=True)
START, STOP = Order.START, Order.STOP
CURRENT = 10.0  # [A] of a battery that charges


def at(step: Step, **values: object) -> Task:
    return Task(0.0, 0.0, 0.0, step=step, **values)  # type: ignore[arg-type]


def test_the_dock_of_the_photograph_is_served_by_its_name() -> None:
    settings = DockTaskSettings(dock_id='home', dock_type='photograph')
    task = requested(Request(dock_id='home', dock_type='photograph'), 0.0, settings)
    assert (task.outcome, task.orders) == (None, (STOP,))


def test_the_stop_at_its_end_is_ordered_once() -> None:
    end = canceled(at(Step.RUNNING), 'canceled')
    assert answered(end, STOP, '', 1.0).orders == ()


def test_a_start_of_the_attempt_before_starts_nothing() -> None:
    task = answered(at(Step.CLEARING, cleared=True), START, '', 1.0)
    assert (task.step, task.stopped, task.orders) == (Step.CLEARING, False, ())


def test_a_stop_that_is_answered_late_starts_nothing_and_keeps_the_time() -> None:
    for step in (Step.STARTING, Step.RUNNING, Step.CHARGING):
        task = answered(at(step, cleared=True, stopped=True), STOP, '', 1.0)
        assert (task.step, task.step_began, task.orders) == (step, 0.0, ())


def test_a_start_that_is_answered_twice_keeps_the_time() -> None:
    for step in (Step.RUNNING, Step.CHARGING):
        task = answered(at(step), START, '', 1.0)
        assert (task.step, task.step_began) == (step, 0.0)


def test_a_servo_that_waits_before_it_is_told_to_stop_has_been_cleared() -> None:
    task = requested(Request(), 0.0, SETTINGS)
    for phase in (Phase.WAITING, Phase.HOLDING):
        task = said(task, phase, '', 0.1, SETTINGS)
    assert answered(task, STOP, '', 0.2).orders == (START,)


def test_a_servo_that_drives_before_its_start_is_answered_drives() -> None:
    task = said(at(Step.STARTING), Phase.DISPLACING, '', 0.1, SETTINGS)
    assert task.driven
    task = said(task, Phase.WAITING, '', 0.2, SETTINGS)  # of before: they may overtake each other
    assert task.outcome is None


def test_at_the_dock_nothing_that_the_servo_says_ends_the_wait_for_a_current() -> None:
    for phase in (Phase.WAITING, Phase.FAILED, Phase.ARRIVED, Phase.DISPLACING):
        task = said(at(Step.CHARGING, driven=True), phase, '', 1.0, CHARGING)
        assert (task.step, task.step_began, task.outcome) == (Step.CHARGING, 0.0, None)


def test_a_current_before_it_has_arrived_docks_nothing() -> None:
    for step in (Step.CLEARING, Step.STARTING, Step.RUNNING):
        assert charging(at(step, driven=True), CURRENT, CHARGING).outcome is None


def test_a_current_after_the_end_changes_nothing() -> None:
    end = passed(at(Step.CHARGING), CHARGING.wait_charge_timeout + 0.1, CHARGING)
    assert end.outcome is not None
    assert end.outcome.error is Error.FAILED_TO_CHARGE
    assert charging(end, CURRENT, CHARGING).outcome is end.outcome


def test_a_failure_without_a_reason_has_words() -> None:
    settings = DockTaskSettings(max_retries=0)
    task = said(at(Step.RUNNING), Phase.FAILED, '', 1.0, settings)
    assert task.outcome is not None
    assert task.outcome.message == 'the servo failed'


def test_the_time_it_takes_is_never_below_zero_or_none() -> None:
    task = at(Step.RUNNING)
    assert [elapsed(task, now) for now in (5.0, -1.0, math.inf, math.nan)] == [5.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize('step', [Step.CLEARING, Step.STARTING])
def test_a_servo_that_never_begins_anew_is_given_up_though_it_talks(step: Step) -> None:
    """Its phase may be that of another robot's servo."""
    task = said(
        at(step), Phase.ARRIVED if step is Step.CLEARING else Phase.WAITING, '', 5.0, SETTINGS
    )
    assert passed(task, SETTINGS.servo_timeout, SETTINGS).outcome is None
    task = passed(task, SETTINGS.servo_timeout + 0.1, SETTINGS)
    assert task.outcome is not None and task.outcome.error is Error.UNKNOWN
    assert (task.outcome.message, task.orders) == (
        'the servo has not begun anew for 5.1 s; is phase that of this servo?',
        (STOP,),
    )
