"""Requests to dock: each phase of the servo is a state, each reason an error, each end final."""

from dataclasses import replace

import pytest

from visual_servo_epipolar.core.docking.task import (
    accept_request,
    DockTaskSettings,
    end,
    Error,
    on_answer,
    on_report,
    on_tick,
    ServoOrder,
    Stage,
    State,
    Task,
)
from visual_servo_epipolar.core.laws.phase import Phase

SETTINGS = DockTaskSettings()
START, STOP = ServoOrder.START, ServoOrder.STOP


def asked():
    return accept_request(True, '', 0.0, SETTINGS)


def running(task=None):
    """Return the task, or a new one, after its servo was stopped and started."""
    task = task or asked()
    assert task.orders == (STOP,)
    task = on_report(task, Phase.WAITING, '', 0.0)
    task = on_answer(task, STOP, '', 0.0)
    assert task.orders == (START,)
    return on_answer(task, START, '', 0.0)


def heard(task, *phases, reason='', now=1.0):
    for phase in phases:
        task = on_report(task, phase, reason, now)
    return task


def at(step: Stage, **values: object) -> Task:
    return Task(0.0, 0.0, 0.0, step=step, **values)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ('by_id', 'dock_id', 'error'),
    [
        (False, '', Error.DOCK_NOT_VALID),
        (True, 'elsewhere', Error.DOCK_NOT_IN_DB),
        (True, 'home', None),
        (True, '', None),
    ],
)
def test_a_dock_without_a_photograph_is_refused(by_id, dock_id, error) -> None:
    task = accept_request(by_id, dock_id, 0.0, DockTaskSettings(dock_id='home'))
    assert (task.outcome and task.outcome.error) is error
    assert task.orders == (STOP,)


def test_reports_of_an_earlier_run_do_not_count() -> None:
    task = heard(asked(), Phase.ARRIVED)
    assert task.outcome is None
    task = on_answer(task, STOP, '', 0.1)
    assert task.orders == ()  # it has not said that it waits
    task = heard(task, Phase.ARRIVED)
    assert task.outcome is None
    task = heard(task, Phase.WAITING)
    assert task.orders == (START,)


def test_a_servo_that_waits_before_its_stop_is_answered_has_been_cleared() -> None:
    task = heard(asked(), Phase.WAITING, Phase.HOLDING)
    assert on_answer(task, STOP, '', 0.2).orders == (START,)


def test_a_robot_that_stands_at_the_dock_is_docked_at_once() -> None:
    assert heard(running(), Phase.WAITING, Phase.ARRIVED).outcome.success


@pytest.mark.parametrize(
    ('phases', 'error'),
    [
        ((Phase.MATCHING_FEATURES,), Error.FAILED_TO_CONTROL),
        ((Phase.DISPLACING, Phase.HOLDING), Error.FAILED_TO_DETECT_DOCK),
        ((), Error.FAILED_TO_DETECT_DOCK),
    ],
    ids=['approaching', 'lost', 'never seen'],
)
def test_a_failure_is_an_error_by_what_the_servo_did_before(phases, error) -> None:
    task = heard(running(), *phases)
    assert task.state is (State.CONTROLLING if phases else State.INITIAL_PERCEPTION)
    task = heard(task, Phase.FAILED, reason='of reasons')
    assert (task.outcome.error, task.outcome.message) == (error, 'of reasons')
    assert task.orders == (STOP,)


@pytest.mark.parametrize(
    ('phases', 'error'),
    [((Phase.DISPLACING,), Error.FAILED_TO_CONTROL), ((), Error.FAILED_TO_DETECT_DOCK)],
    ids=['while it drives', 'before'],
)
def test_a_servo_that_falls_silent_is_stopped(phases, error) -> None:
    task = heard(running(), *phases, now=0.0)
    assert on_tick(task, SETTINGS.servo_timeout, SETTINGS).outcome is None
    task = on_tick(task, SETTINGS.servo_timeout + 0.1, SETTINGS)
    assert task.outcome.error is error
    assert task.orders == (STOP,)


@pytest.mark.parametrize('step', [Stage.CLEARING, Stage.STARTING])
def test_a_servo_that_never_begins_anew_is_given_up_though_it_talks(step: Stage) -> None:
    """Its phase may be that of another robot's servo."""
    phase = Phase.ARRIVED if step is Stage.CLEARING else Phase.WAITING
    task = heard(at(step), phase, now=5.0)
    assert on_tick(task, SETTINGS.servo_timeout, SETTINGS).outcome is None
    task = on_tick(task, SETTINGS.servo_timeout + 0.1, SETTINGS)
    assert task.outcome is not None and task.outcome.error is Error.UNKNOWN
    assert task.outcome.message.startswith('the servo has not begun anew for 5.1 s')
    assert task.orders == (STOP,)


def test_a_servo_that_is_stopped_from_elsewhere() -> None:
    task = heard(running(), Phase.DISPLACING, Phase.WAITING)
    assert task.outcome.error is Error.FAILED_TO_CONTROL


@pytest.mark.parametrize('step', Stage)
def test_an_end_from_outside_stops_the_servo_in_every_step(step) -> None:
    task = end(at(step), Error.NONE, 'canceled', canceled=True)
    assert task.orders == (STOP,)
    assert (task.outcome.canceled, task.outcome.success) == (True, False)
    assert on_answer(task, STOP, '', 1.0).orders == ()


def test_a_servo_that_starts_after_the_end_is_stopped_again() -> None:
    gone = end(running(), Error.UNKNOWN, 'the node ends')
    late = on_answer(gone, START, '', 2.0)
    assert late.orders == (STOP,)
    assert late.outcome is gone.outcome
    assert on_answer(gone, START, 'refused', 2.0).orders == ()
    docked = heard(running(), Phase.ARRIVED)
    assert on_answer(docked, START, '', 2.0).orders == ()


def test_an_end_is_final() -> None:
    docked = heard(running(), Phase.ARRIVED)
    for after in (
        heard(docked, Phase.FAILED),
        on_tick(docked, 1e4, SETTINGS),
        on_answer(docked, STOP, 'refused', 2.0),
    ):
        assert after.outcome is docked.outcome
        assert after.orders == ()


def test_a_servo_whose_order_has_lapsed_has_not_seen_the_photograph() -> None:
    task = heard(running(), None)
    assert (task.outcome, task.heard) == (None, 1.0)
    task = heard(task, Phase.WAITING, reason='~/start has expired')
    assert (task.outcome.error, task.orders) == (Error.FAILED_TO_DETECT_DOCK, (STOP,))


def test_a_servo_that_waits_before_it_has_been_armed_has_not_lapsed() -> None:
    assert heard(running(), Phase.WAITING).orders == ()
    task = running(replace(heard(asked(), None), orders=(STOP,)))  # armed by an earlier order
    assert heard(task, Phase.WAITING).outcome is None
    assert heard(task, Phase.WAITING).orders == ()


def test_answers_out_of_order_start_nothing_and_keep_the_time() -> None:
    task = on_answer(at(Stage.CLEARING, cleared=True), START, '', 1.0)
    assert (task.step, task.stopped, task.orders) == (Stage.CLEARING, False, ())
    for step in (Stage.STARTING, Stage.RUNNING):
        task = on_answer(at(step, cleared=True, stopped=True), STOP, '', 1.0)
        assert (task.step, task.step_began, task.orders) == (step, 0.0, ())
    task = on_answer(at(Stage.RUNNING), START, '', 1.0)
    assert (task.step, task.step_began) == (Stage.RUNNING, 0.0)


def test_a_servo_that_drives_before_its_start_is_answered_drives() -> None:
    task = heard(at(Stage.STARTING), Phase.DISPLACING)
    assert task.driven
    assert heard(task, Phase.WAITING).outcome is None  # of before
