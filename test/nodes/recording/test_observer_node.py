"""The observer forgets what never becomes a step."""

from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
import pytest

from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.messages import diagnostics, write
from visual_servo_epipolar.messages.diagnostics import Words
from visual_servo_epipolar.nodes.recording.observer_node import ObserverNode, UNFINISHED
from visual_servo_epipolar.simulation.run_monitor import RunMonitor


@pytest.fixture
def observer(bench):
    """Yield an observer; nothing here gets as far as its monitor."""
    kind = partial(ObserverNode, RunMonitor, lambda *_: None, with_images=False)
    return bench.start(kind)


def diagnose(observer, message) -> None:
    (listen,) = (
        item.callback for item in observer.subscriptions if item.topic_name == '/diagnostics'
    )
    listen(message)


def test_diagnostics_of_others_do_not_pile_up(observer) -> None:
    for stamp_ns in range(1, 5 * UNFINISHED):
        foreign = write.diagnostics('x', level=b'\0', summary='', values={}, stamp_ns=stamp_ns)
        between = diagnostics.standing_diagnosis(
            ServoState(), Words('it stands'), stamp_ns, name='servo', alarming=False
        )
        for message in (foreign, between, DiagnosticArray()):
            diagnose(observer, message)
    assert observer._pending == {}


def test_steps_that_are_never_whole_are_forgotten_in_the_end(observer) -> None:
    for stamp_ns in range(1, 5 * UNFINISHED):
        diagnose(observer, diagnostics.diagnosis(ServoState(), stamp_ns, name='another'))
    assert len(observer._pending) <= UNFINISHED
