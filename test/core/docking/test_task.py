"""Requests to dock: each phase of the servo is a state, each reason an error, each end final."""

import pytest

from visual_servo_epipolar.core.docking.task import DockRequest, DockTaskSettings, Error, State
from visual_servo_epipolar.core.laws.phase import Phase

TIMEOUT = DockTaskSettings().servo_timeout


class Request(DockRequest):
    """A request for the dock of a photograph, with the orders that it has given."""

    def __init__(self, by_id=True, dock_id='', has='') -> None:
        self.orders = []
        super().__init__(self.orders.append, 0.0)
        self.accept(by_id, dock_id, DockTaskSettings(dock_id=has))

    def hears(self, *phases, reason='', now=1.0):
        for phase in phases:
            self.heard(phase, reason, now)
        return self


def starting():
    """Return a request whose servo has been ordered to start, and has not answered."""
    request = Request().hears(Phase.WAITING, now=0.0)
    request.answered('stop', '', 0.0)
    assert request.orders == ['stop', 'start']
    return request


def running():
    request = starting()
    request.answered('start', '', 0.0)
    return request


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
    request = Request(by_id, dock_id, has='home')
    assert (request.outcome and request.outcome.error) is error
    assert request.orders == ['stop']


def test_reports_of_an_earlier_run_do_not_count() -> None:
    request = Request().hears(None, Phase.ARRIVED)
    request.answered('stop', '', 0.1)
    request.hears(Phase.ARRIVED)
    assert (request.outcome, request.orders) == (None, ['stop'])  # the servo does not wait yet
    request.hears(Phase.WAITING)
    assert request.orders == ['stop', 'start']
    request.answered('start', '', 0.1)
    assert request.hears(Phase.WAITING).outcome is None  # it was armed by an earlier order


def test_a_servo_that_waits_before_its_stop_is_answered_has_been_cleared() -> None:
    request = Request().hears(Phase.WAITING, Phase.HOLDING)
    request.answered('start', '', 0.1)  # of an earlier request
    assert request.orders == ['stop']
    request.answered('stop', '', 0.2)
    assert request.orders == ['stop', 'start']


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
    request = running().hears(*phases)
    assert request.state is (State.CONTROLLING if phases else State.INITIAL_PERCEPTION)
    request.hears(Phase.FAILED, reason='of reasons')
    assert (request.outcome.error, request.outcome.message) == (error, 'of reasons')
    assert request.orders[2:] == ['stop']


@pytest.mark.parametrize(
    ('phases', 'error'),
    [((Phase.DISPLACING,), Error.FAILED_TO_CONTROL), ((), Error.FAILED_TO_DETECT_DOCK)],
    ids=['while it drives', 'before'],
)
def test_a_servo_that_falls_silent_is_stopped(phases, error) -> None:
    request = running().hears(*phases, now=0.0)
    request.tick(TIMEOUT, TIMEOUT)
    assert request.outcome is None
    request.tick(TIMEOUT + 0.1, TIMEOUT)
    assert request.outcome.error is error
    assert request.orders[2:] == ['stop']
    patient = running().hears(Phase.DISPLACING, now=100.0)
    patient.tick(100.0 + TIMEOUT, TIMEOUT)
    assert patient.outcome is None  # one that runs may take its time


@pytest.mark.parametrize(('begin', 'phase'), [(Request, Phase.ARRIVED), (starting, Phase.WAITING)])
def test_a_servo_that_never_begins_anew_is_given_up_though_it_talks(begin, phase) -> None:
    """Its phase may be that of another robot's servo."""
    request = begin().hears(phase, now=5.0)
    request.tick(TIMEOUT, TIMEOUT)
    assert request.outcome is None
    request.tick(TIMEOUT + 0.1, TIMEOUT)
    assert request.outcome.error is Error.UNKNOWN
    assert request.outcome.message.startswith('the servo has not begun anew for 5.1 s')
    assert request.orders[-1] == 'stop'


@pytest.mark.parametrize('begin', [Request, starting, running])
def test_an_end_from_outside_stops_the_servo_and_is_final(begin) -> None:
    request = begin()
    before = len(request.orders)
    request.end(Error.NONE, 'canceled', canceled=True)
    assert request.orders[before:] == ['stop']
    outcome = request.outcome
    assert (outcome.canceled, outcome.success) == (True, False)
    request.answered('stop', 'refused', 1.0)
    request.hears(Phase.WAITING, Phase.FAILED)
    request.tick(1e4, TIMEOUT)
    assert request.outcome is outcome
    assert len(request.orders) == before + 1


def test_a_servo_that_stops_by_another_order_or_lapses_ends_it() -> None:
    assert running().hears(Phase.WAITING).outcome is None  # it has not been armed yet
    request = running().hears(Phase.DISPLACING, Phase.WAITING)
    assert request.outcome.error is Error.FAILED_TO_CONTROL
    request = running().hears(None).hears(Phase.WAITING, reason='~/start has expired')
    assert request.outcome.error is Error.FAILED_TO_DETECT_DOCK
    assert request.orders[2:] == ['stop']


def test_a_servo_that_drives_before_its_start_is_answered_drives() -> None:
    request = starting().hears(Phase.DISPLACING)
    assert request.driven
    assert request.hears(Phase.WAITING).outcome is None  # of before
