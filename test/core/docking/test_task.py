"""Requests to dock: each phase of the servo is a state, each reason an error, each end final."""

from dataclasses import replace

import pytest
from servo_states import DRIVING

from visual_servo_epipolar.core.docking.settings import DockTaskSettings
from visual_servo_epipolar.core.docking.task import (
    abandon,
    accept_request,
    cancel,
    elapsed,
    Error,
    on_answer,
    on_armed,
    on_battery,
    on_phase,
    on_tick,
    Request,
    ServoOrder,
    Stage,
    State,
    Task,
)
from visual_servo_epipolar.core.laws.phase import Phase

SETTINGS = DockTaskSettings(max_retries=1)
CHARGING = DockTaskSettings(max_retries=1, wait_for_charge=True)


def running(settings=SETTINGS, now=0.0):
    """Return a task whose servo has been started."""
    return again(accept_request(Request(), now, settings), now, settings)


def again(task, now, settings=SETTINGS):
    """Return the task after an attempt was begun as it asks for."""
    assert task.orders == (ServoOrder.STOP,)
    task = on_phase(task, Phase.WAITING, '', now, settings)
    task = on_answer(task, ServoOrder.STOP, '', now)
    assert task.orders == (ServoOrder.START,)
    return on_answer(task, ServoOrder.START, '', now)


def heard(task, *phases, reason='', now=1.0, settings=SETTINGS):
    for phase in phases:
        task = on_phase(task, phase, reason, now, settings)
    return task


def test_the_usual_way() -> None:
    task = running()
    assert task.state is State.INITIAL_PERCEPTION
    task = heard(task, Phase.RETREATING)
    assert task.state is State.NAV_TO_STAGING_POSE
    task = heard(task, Phase.DISPLACING)
    assert task.state is State.CONTROLLING
    task = heard(task, Phase.HOLDING, Phase.MATCHING_FEATURES)
    assert task.outcome is None
    task = heard(task, Phase.ARRIVED)
    assert task.outcome.success
    assert task.outcome.error is Error.NONE
    assert task.orders == ()


@pytest.mark.parametrize('phase', DRIVING)
def test_every_phase_that_drives_has_a_state(phase) -> None:
    expected = State.NAV_TO_STAGING_POSE if phase is Phase.RETREATING else State.CONTROLLING
    assert heard(running(), phase).state is expected


def test_numbers_are_those_of_the_action() -> None:
    assert [int(state) for state in State] == [0, 1, 2, 3, 4, 5]
    assert [int(error) for error in Error] == [0, 901, 902, 903, 904, 905, 906, 999]


@pytest.mark.parametrize(
    ('request_', 'error'),
    [
        (Request(by_id=False), Error.DOCK_NOT_VALID),
        (Request(dock_id='elsewhere'), Error.DOCK_NOT_IN_DB),
    ],
    ids=['a pose', 'another dock'],
)
def test_a_dock_without_a_photograph_is_refused(request_, error) -> None:
    settings = DockTaskSettings(dock_id='home')
    task = accept_request(request_, 0.0, settings)
    assert task.outcome.error is error
    assert ServoOrder.START not in task.orders


def test_names_that_nobody_set_fit_every_request() -> None:
    assert accept_request(Request(dock_id='any'), 0.0, SETTINGS).outcome is None


def test_what_an_earlier_run_said_does_not_count() -> None:
    task = accept_request(Request(), 0.0, SETTINGS)
    task = heard(task, Phase.ARRIVED)
    assert task.outcome is None
    task = on_answer(task, ServoOrder.STOP, '', 0.1)
    assert task.orders == ()  # it has not said that it waits
    task = heard(task, Phase.ARRIVED)
    assert task.outcome is None
    task = heard(task, Phase.WAITING)
    assert task.orders == (ServoOrder.START,)


def test_a_robot_that_stands_at_the_dock_is_docked_at_once() -> None:
    assert heard(running(), Phase.WAITING, Phase.ARRIVED).outcome.success


@pytest.mark.parametrize(
    ('phases', 'error'),
    [
        ((Phase.RETREATING,), Error.FAILED_TO_STAGE),
        ((Phase.MATCHING_FEATURES,), Error.FAILED_TO_CONTROL),
        ((Phase.DISPLACING, Phase.HOLDING), Error.FAILED_TO_DETECT_DOCK),
        ((), Error.FAILED_TO_DETECT_DOCK),
    ],
    ids=['backing off', 'approaching', 'lost', 'never seen'],
)
def test_a_failure_is_tried_again_and_then_is_an_error(phases, error) -> None:
    task = heard(running(), *phases, Phase.FAILED, reason='of reasons')
    assert task.outcome is None
    assert (task.state, task.retries) == (State.RETRY, 1)
    task = heard(again(task, 2.0), *phases, Phase.FAILED, reason='of reasons', now=3.0)
    assert task.outcome.error is error
    assert task.outcome.message == 'of reasons'
    assert task.retries == 1


def test_after_a_retry_it_controls_and_docks() -> None:
    task = again(heard(running(), Phase.DISPLACING, Phase.FAILED), 2.0)
    assert task.state is State.RETRY
    task = heard(task, Phase.RETREATING, now=3.0)
    assert task.state is State.CONTROLLING
    task = heard(task, Phase.ARRIVED, now=4.0)
    assert task.outcome.success
    assert task.retries == 1


def test_a_photograph_that_is_not_seen_in_time() -> None:
    task = heard(running(), Phase.WAITING, now=1.0)
    task = on_tick(task, SETTINGS.initial_perception_timeout, SETTINGS)
    assert task.retries == 0
    task = heard(task, Phase.HOLDING, now=4.9)
    task = on_tick(task, SETTINGS.initial_perception_timeout + 0.1, SETTINGS)
    assert task.retries == 1
    assert task.orders == (ServoOrder.STOP,)


def test_an_approach_that_takes_too_long() -> None:
    settings = replace(SETTINGS, max_retries=0, dock_approach_timeout=20.0)
    task = heard(running(settings), Phase.DISPLACING, now=20.0, settings=settings)
    assert on_tick(task, 20.0, settings).outcome is None
    task = on_tick(task, 20.1, settings)
    assert task.outcome.error is Error.FAILED_TO_CONTROL
    assert task.orders == (ServoOrder.STOP,)


@pytest.mark.parametrize(
    ('phases', 'error'),
    [
        ((Phase.DISPLACING,), Error.FAILED_TO_CONTROL),
        ((), Error.FAILED_TO_DETECT_DOCK),
    ],
    ids=['while it drives', 'before'],
)
def test_a_servo_that_falls_silent_is_stopped_and_not_tried_again(phases, error) -> None:
    task = heard(running(), *phases, now=0.0)
    assert on_tick(task, SETTINGS.servo_timeout, SETTINGS).outcome is None
    task = on_tick(task, SETTINGS.servo_timeout + 0.1, SETTINGS)
    assert task.outcome.error is error
    assert task.orders == (ServoOrder.STOP,)


def test_a_servo_that_somebody_else_stops() -> None:
    task = heard(running(), Phase.DISPLACING, Phase.WAITING)
    assert task.outcome.error is Error.FAILED_TO_CONTROL
    assert 'somebody else' in task.outcome.message


def test_a_servo_that_is_not_there() -> None:
    task = on_answer(
        accept_request(Request(), 0.0, SETTINGS), ServoOrder.STOP, 'nobody serves it', 0.0
    )
    assert task.outcome.error is Error.UNKNOWN
    assert task.outcome.message == 'nobody serves it'


def test_what_charges_is_docked() -> None:
    task = heard(running(CHARGING), Phase.DISPLACING, Phase.ARRIVED, settings=CHARGING)
    assert (task.state, task.outcome) == (State.WAIT_FOR_CHARGE, None)
    assert on_battery(task, CHARGING.charging_threshold, CHARGING).outcome is None
    assert on_battery(task, 0.6, CHARGING).outcome.success


def test_what_does_not_charge_is_an_error_and_not_tried_again() -> None:
    task = heard(running(CHARGING), Phase.DISPLACING, Phase.ARRIVED, settings=CHARGING)
    assert on_tick(task, 1.0 + CHARGING.wait_charge_timeout, CHARGING).outcome is None
    task = on_tick(task, 1.1 + CHARGING.wait_charge_timeout, CHARGING)
    assert task.outcome.error is Error.FAILED_TO_CHARGE


@pytest.mark.parametrize('step', Stage)
def test_a_cancel_stops_the_servo_in_every_step(step) -> None:
    task = cancel(Task(0.0, 0.0, 0.0, step=step))
    assert task.orders == (ServoOrder.STOP,)
    assert task.outcome.canceled
    assert not task.outcome.success


@pytest.mark.parametrize('step', Stage)
def test_what_is_given_up_is_an_error_and_stops_the_servo_in_every_step(step) -> None:
    task = abandon(Task(0.0, 0.0, 0.0, step=step), 'no longer active')
    assert task.orders == (ServoOrder.STOP,)
    assert (task.outcome.error, task.outcome.message) == (Error.UNKNOWN, 'no longer active')
    assert not task.outcome.canceled


def test_a_servo_that_starts_after_the_end_is_stopped_again() -> None:
    end = cancel(running())
    late = on_answer(end, ServoOrder.START, '', 2.0)
    assert late.orders == (ServoOrder.STOP,)
    assert late.outcome is end.outcome
    assert on_answer(end, ServoOrder.START, 'refused', 2.0).orders == ()
    docked = heard(running(), Phase.ARRIVED)
    assert on_answer(docked, ServoOrder.START, '', 2.0).orders == ()


def test_an_end_is_final() -> None:
    end = heard(running(), Phase.ARRIVED)
    for after in (
        heard(end, Phase.FAILED),
        on_tick(end, 1e4, SETTINGS),
        on_answer(end, ServoOrder.STOP, 'refused', 2.0),
        on_battery(end, 10.0, SETTINGS),
    ):
        assert after.outcome is end.outcome
        assert after.orders == ()


def test_a_servo_whose_order_has_lapsed_has_not_seen_the_photograph() -> None:
    task = on_armed(running(), 1.0)
    assert (task.outcome, task.heard) == (None, 1.0)
    task = heard(task, Phase.WAITING, reason='~/start has expired')
    assert (task.state, task.retries, task.orders) == (State.RETRY, 1, (ServoOrder.STOP,))
    task = heard(on_armed(again(task, 2.0), 2.0), Phase.WAITING, reason='it has lapsed', now=3.0)
    assert (task.outcome.error, task.outcome.message) == (
        Error.FAILED_TO_DETECT_DOCK,
        'it has lapsed',
    )


def test_who_waits_before_the_servo_has_been_armed_has_not_lapsed() -> None:
    assert heard(running(), Phase.WAITING).orders == ()
    task = on_armed(accept_request(Request(), 0.0, SETTINGS), 0.0)  # by an earlier order
    task = on_answer(on_phase(task, Phase.WAITING, '', 0.0, SETTINGS), ServoOrder.STOP, '', 0.0)
    task = on_answer(task, ServoOrder.START, '', 0.0)
    assert heard(task, Phase.WAITING).outcome is None
    assert heard(task, Phase.WAITING).orders == ()


CHARGING_TASK_ORDER = DockTaskSettings(wait_for_charge=True)
START, STOP = ServoOrder.START, ServoOrder.STOP
CURRENT = 10.0  # [A] of a battery that charges


def at(step: Stage, **values: object) -> Task:
    return Task(0.0, 0.0, 0.0, step=step, **values)  # type: ignore[arg-type]


def test_the_dock_of_the_photograph_is_served_by_its_name() -> None:
    settings = DockTaskSettings(dock_id='home')
    task = accept_request(Request(dock_id='home'), 0.0, settings)
    assert (task.outcome, task.orders) == (None, (STOP,))


def test_the_stop_at_its_end_is_ordered_once() -> None:
    end = cancel(at(Stage.RUNNING))
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
        task = on_phase(at(Stage.CHARGING, driven=True), phase, '', 1.0, CHARGING_TASK_ORDER)
        assert (task.step, task.step_began, task.outcome) == (Stage.CHARGING, 0.0, None)


def test_a_current_before_it_has_arrived_docks_nothing() -> None:
    for step in (Stage.CLEARING, Stage.STARTING, Stage.RUNNING):
        assert on_battery(at(step, driven=True), CURRENT, CHARGING_TASK_ORDER).outcome is None


def test_a_current_after_the_end_changes_nothing() -> None:
    end = on_tick(
        at(Stage.CHARGING), CHARGING_TASK_ORDER.wait_charge_timeout + 0.1, CHARGING_TASK_ORDER
    )
    assert end.outcome is not None
    assert end.outcome.error is Error.FAILED_TO_CHARGE
    assert on_battery(end, CURRENT, CHARGING_TASK_ORDER).outcome is end.outcome


def test_a_failure_without_a_reason_has_words() -> None:
    settings = DockTaskSettings(max_retries=0)
    task = on_phase(at(Stage.RUNNING), Phase.FAILED, '', 1.0, settings)
    assert task.outcome is not None
    assert task.outcome.message == 'the servo failed'


def test_the_time_it_takes_is_never_below_zero_or_none() -> None:
    task = at(Stage.RUNNING)
    assert [elapsed(task, now) for now in (5.0, -1.0)] == [5.0, 0.0]


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
