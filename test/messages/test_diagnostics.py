"""Diagnostics: who is carried on by the memory of views is warned of, and of what was refuted."""

from dataclasses import replace

from diagnostic_msgs.msg import DiagnosticStatus
import pytest
from servo_states import in_phase, MEMORY, sight

from visual_servo_epipolar.core.servo.identification.odometry import Odometry
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


def test_odometry_that_is_not_used_any_more_is_a_warning() -> None:
    state = in_phase(Phase.ZEROING_EPIPOLES, measurement=sight(), memory=MEMORY)
    state = replace(state, odometry=Odometry(refuted='odometry leaps'))
    status = diagnosis(state, 1, name='servo').status[0]
    words = 'zeroing_epipoles; odometry leaps'
    assert (status.level, status.message) == (DiagnosticStatus.WARN, words)
    assert {item.key: item.value for item in status.values}['odometry'] == 'odometry leaps'
