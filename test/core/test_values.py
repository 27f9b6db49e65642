"""Changed copies of frozen values."""

from dataclasses import FrozenInstanceError, replace

import pytest

from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.values import changed
from visual_servo_epipolar.evaluation.benchmarks.arrivals.peer_steps import PeerState


def test_a_changed_copy_is_what_replace_gives() -> None:
    state = PeerState(distance=2.0, backwards=True)
    copy = changed(state, settled=3, still=1)
    assert copy == replace(state, settled=3, still=1)
    assert (state.settled, state.still) == (0, 0)


def test_a_changed_copy_is_frozen() -> None:
    with pytest.raises(FrozenInstanceError):
        changed(ServoState(), settled=3).settled = 4  # type: ignore[misc]


def test_a_misspelt_field_is_refused() -> None:
    with pytest.raises(TypeError, match='ServoState has no field setled'):
        changed(ServoState(), setled=3)
