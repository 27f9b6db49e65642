"""Reasons: decided by name, read as text; the table has each text once."""

import pickle
from string import Formatter

import pytest

from visual_servo_epipolar.core.reasons import Reason, reason_of


@pytest.mark.parametrize('reason', Reason)
def test_a_text_keeps_its_reason_in_another_process_and_reads_as_any_text(reason: Reason) -> None:
    values = [
        1.0 if spec else 'word'
        for _, name, spec, _ in Formatter().parse(reason.value)
        if name is not None
    ]
    text = pickle.loads(pickle.dumps(reason.of(*values)))
    assert reason_of(text) is reason
    assert text == reason.value.format(*values)


def test_a_text_from_elsewhere_is_another_reason_whatever_its_words() -> None:
    assert reason_of(Reason.TILTED.value) is Reason.OTHER
    assert reason_of('') is Reason.NONE
