"""Diagnostics: who is carried on by the memory of views is warned of."""

from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from servo_states import in_phase, MEMORY, sight

from visual_servo_epipolar.core.servo.phases.table import Phase
from visual_servo_epipolar.messages.diagnostics import diagnosis


@pytest.mark.parametrize(
    ('carried', 'level', 'words'),
    [
        (False, DiagnosticStatus.OK, 'zeroing_epipoles'),
        (
            True,
            DiagnosticStatus.WARN,
            'zeroing_epipoles; 8 features in view, by the memory of views',
        ),
    ],
)
def test_too_few_features_are_a_warning_while_the_memory_carries_on(
    carried: bool, level: bytes, words: str
) -> None:
    state = in_phase(
        Phase.ZEROING_EPIPOLES, measurement=sight(features=8, carried=carried), memory=MEMORY
    )
    status = diagnosis(state, 1, name='servo').status[0]
    assert (status.level, status.message) == (level, words)
