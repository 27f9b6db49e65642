"""Diagnostics: who is carried on by the memory of views is warned of, and of what was refuted."""

from diagnostic_msgs.msg import DiagnosticStatus
from hypothesis import given
from hypothesis import strategies as st
import pytest
from servo_states import EVENTS, in_phase, MEMORY, PHASES, sight

from visual_servo_epipolar.core.estimate.odometry import Odometry
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.registry import phase_words, sentence
from visual_servo_epipolar.core.laws.two_steps import TWO_STEPS
from visual_servo_epipolar.messages import event_log
from visual_servo_epipolar.messages.diagnostics import diagnosis, markers

STEP_1 = 'zeroing_epipoles: the robot drives onto the axis of the photograph (step 1)'


@pytest.mark.parametrize(
    ('carried', 'level', 'words'),
    [
        (False, DiagnosticStatus.OK, STEP_1),
        (True, DiagnosticStatus.WARN, f'{STEP_1}; 8 features in view, by the memory of views'),
    ],
)
def test_too_few_features_are_a_warning_while_the_memory_carries_on(carried, level, words) -> None:
    state = in_phase(
        Phase.ZEROING_EPIPOLES, measurement=sight(features=8, carried=carried), memory=MEMORY
    )
    status = diagnosis(state, 1, name='servo').status[0]
    assert (status.level, status.message) == (level, words)


def test_odometry_that_is_not_used_any_more_is_a_warning() -> None:
    state = in_phase(Phase.ZEROING_EPIPOLES, measurement=sight(), memory=MEMORY)
    state = state.changed(odometry=Odometry(refuted='odometry leaps'))
    status = diagnosis(state, 1, name='servo').status[0]
    words = f'{STEP_1}; odometry leaps'
    assert (status.level, status.message) == (DiagnosticStatus.WARN, words)
    assert {item.key: item.value for item in status.values}['odometry'] == 'odometry leaps'


@pytest.mark.parametrize('phase', PHASES)
def test_what_a_phase_does_is_said_in_a_sentence(phase: Phase) -> None:
    reasons = [event for (_, event), then in TWO_STEPS.transitions.items() if then is phase]
    for reason in ('', *(event.value for event in reasons if event.sentence)):
        text = sentence(phase, reason)
        assert text.startswith(f'{phase.value}: ') and len(text.split()) >= 4
        assert not reason or not text.endswith(f' {reason}')
    assert phase_words(phase.value)


def test_an_event_that_is_a_reason_by_its_name_has_words() -> None:
    state = in_phase(Phase.DISPLACING, measurement=sight(), memory=MEMORY)
    status = diagnosis(state.changed(reason=Event.APART.value), 1, name='servo').status[0]
    assert status.message.endswith('; both epipoles can be trusted')
    with_own_reason = {Event.NOTHING, Event.LOST, Event.MISSED, Event.EXHAUSTED, Event.NO_GAIN}
    with_own_reason |= {Event.DIVERGED, Event.EXCURSION, Event.TIMED_OUT, Event.STOPPED}
    with_own_reason |= {Event.DISOBEYED}
    assert with_own_reason == {event for event in EVENTS if not event.sentence}


def test_the_marker_of_a_phase_has_the_colour_of_its_row() -> None:
    words = markers(in_phase(Phase.DISPLACING), 1, 'camera').markers[0]
    assert words.text == 'displacing'
    colour = [round(255.0 * part) for part in (words.color.r, words.color.g, words.color.b)]
    assert bytes(colour).hex().upper() == TWO_STEPS.rows[Phase.DISPLACING].colour[1:]


@given(reason=st.text(), after=st.none() | st.integers(0, 2**63))
def test_an_entry_comes_back(reason: str, after: int | None) -> None:
    entry = event_log.Entry('lost', after, reason)
    assert event_log.from_text(event_log.to_text(entry)) == entry


@pytest.mark.parametrize(
    'text', ['', '3', '{}', '{"event": "lost"}', '[' * 99_999, '{"event":1,"after_stamp_ns":"x"}']
)
def test_any_other_text_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match='an event must be JSON with event'):
        event_log.from_text(text)
