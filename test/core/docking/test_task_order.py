"""Answers, phases and currents that come out of their order: none counts in another step."""

import math

import pytest

from visual_servo_epipolar.core.docking.settings import DockTaskSettings
from visual_servo_epipolar.core.docking.task import (
    accept_request,
    cancel,
    elapsed,
    Error,
    on_answer,
    on_battery,
    on_phase,
    on_tick,
    Request,
    ServoOrder,
    Stage,
    Task,
)
from visual_servo_epipolar.core.laws.phase import Phase

SETTINGS = DockTaskSettings(max_retries=1)
CHARGING = DockTaskSettings(wait_for_charge=True)
START, STOP = ServoOrder.START, ServoOrder.STOP
CURRENT = 10.0  # [A] of a battery that charges


def at(step: Stage, **values: object) -> Task:
    return Task(0.0, 0.0, 0.0, step=step, **values)  # type: ignore[arg-type]


def test_the_dock_of_the_photograph_is_served_by_its_name() -> None:
    settings = DockTaskSettings(dock_id='home', dock_type='photograph')
    task = accept_request(Request(dock_id='home', dock_type='photograph'), 0.0, settings)
    assert (task.outcome, task.orders) == (None, (STOP,))


def test_the_stop_at_its_end_is_ordered_once() -> None:
    end = cancel(at(Stage.RUNNING), 'canceled')
    assert on_answer(end, STOP, '', 1.0).orders == ()


def test_a_start_of_the_attempt_before_starts_nothing() -> None:
    task = on_answer(at(Stage.CLEARING, cleared=True), START, '', 1.0)
    assert (task.step, task.stopped, task.orders) == (Stage.CLEARING, False, ())


def test_a_stop_that_is_answered_late_starts_nothing_and_keeps_the_time() -> None:
    for step in (Stage.STARTING, Stage.RUNNING, Stage.CHARGING):
        task = on_answer(at(step, cleared=True, stopped=True), STOP, '', 1.0)
        assert (task.step, task.step_began, task.orders) == (step, 0.0, ())


def test_a_start_that_is_answered_twice_keeps_the_time() -> None:
    for step in (Stage.RUNNING, Stage.CHARGING):
        task = on_answer(at(step), START, '', 1.0)
        assert (task.step, task.step_began) == (step, 0.0)


def test_a_servo_that_waits_before_it_is_told_to_stop_has_been_cleared() -> None:
    task = accept_request(Request(), 0.0, SETTINGS)
    for phase in (Phase.WAITING, Phase.HOLDING):
        task = on_phase(task, phase, '', 0.1, SETTINGS)
    assert on_answer(task, STOP, '', 0.2).orders == (START,)


def test_a_servo_that_drives_before_its_start_is_answered_drives() -> None:
    task = on_phase(at(Stage.STARTING), Phase.DISPLACING, '', 0.1, SETTINGS)
    assert task.driven
    task = on_phase(task, Phase.WAITING, '', 0.2, SETTINGS)  # of before
    assert task.outcome is None


def test_at_the_dock_nothing_that_the_servo_says_ends_the_wait_for_a_current() -> None:
    for phase in (Phase.WAITING, Phase.FAILED, Phase.ARRIVED, Phase.DISPLACING):
        task = on_phase(at(Stage.CHARGING, driven=True), phase, '', 1.0, CHARGING)
        assert (task.step, task.step_began, task.outcome) == (Stage.CHARGING, 0.0, None)


def test_a_current_before_it_has_arrived_docks_nothing() -> None:
    for step in (Stage.CLEARING, Stage.STARTING, Stage.RUNNING):
        assert on_battery(at(step, driven=True), CURRENT, CHARGING).outcome is None


def test_a_current_after_the_end_changes_nothing() -> None:
    end = on_tick(at(Stage.CHARGING), CHARGING.wait_charge_timeout + 0.1, CHARGING)
    assert end.outcome is not None
    assert end.outcome.error is Error.FAILED_TO_CHARGE
    assert on_battery(end, CURRENT, CHARGING).outcome is end.outcome


def test_a_failure_without_a_reason_has_words() -> None:
    settings = DockTaskSettings(max_retries=0)
    task = on_phase(at(Stage.RUNNING), Phase.FAILED, '', 1.0, settings)
    assert task.outcome is not None
    assert task.outcome.message == 'the servo failed'


def test_the_time_it_takes_is_never_below_zero_or_none() -> None:
    task = at(Stage.RUNNING)
    assert [elapsed(task, now) for now in (5.0, -1.0, math.inf, math.nan)] == [5.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize('step', [Stage.CLEARING, Stage.STARTING])
def test_a_servo_that_never_begins_anew_is_given_up_though_it_talks(step: Stage) -> None:
    """Its phase may be that of another robot's servo."""
    task = on_phase(
        at(step),
        Phase.ARRIVED if step is Stage.CLEARING else Phase.WAITING,
        '',
        5.0,
        SETTINGS,
    )
    assert on_tick(task, SETTINGS.servo_timeout, SETTINGS).outcome is None
    task = on_tick(task, SETTINGS.servo_timeout + 0.1, SETTINGS)
    assert task.outcome is not None and task.outcome.error is Error.UNKNOWN
    assert (task.outcome.message, task.orders) == (
        'the servo has not begun anew for 5.1 s; is phase that of this servo?',
        (STOP,),
    )
