"""Changed copies of frozen values."""

from dataclasses import FrozenInstanceError, replace

import pytest

from visual_servo_epipolar.core.servo.state import MotionState, RunState, ServoState
from visual_servo_epipolar.core.values import changed


def test_a_changed_copy_is_what_replace_gives() -> None:
    motion = MotionState(distance=2.0)
    copy = changed(motion, travel=3.0, range=1.0)
    assert copy == replace(motion, travel=3.0, range=1.0)
    assert motion.travel == 0.0


def test_a_state_changes_fields_of_several_parts() -> None:
    run = RunState(reason='why')
    after = ServoState(run=run).changed(settled=3, attempts=2, known=None)
    assert (after.settling.settled, after.run) == (3, replace(run, attempts=2))


def test_a_changed_copy_is_frozen() -> None:
    with pytest.raises(FrozenInstanceError):
        ServoState().changed(settled=3).settling.settled = 4  # type: ignore[misc]


def test_a_misspelt_field_is_refused() -> None:
    with pytest.raises(TypeError, match='ServoState has no field setled'):
        ServoState().changed(setled=3)
