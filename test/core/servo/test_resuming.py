"""Resuming after images that were not trusted: what a robot that stands cannot have done."""

import math

import pytest
from servo_states import in_phase, seeing, SETTINGS, sight

from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.standing import RESUMING_FRAMES
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import classify, update
from visual_servo_epipolar.core.twoview.memory import fresh_memory
from visual_servo_epipolar.core.twoview.perceive import Perception

THERE = sight()
LONG = RESUMING_FRAMES * SETTINGS.arrival_frames


def held(turned: float, frames: int, before: float | None = None) -> Event:
    heading = THERE.heading_error - turned if before is None else before
    state = in_phase(Phase.HOLDING, measurement=THERE, settled=frames, trusted_heading=heading)
    return classify(state, SETTINGS)


@pytest.mark.parametrize('turned', [0.0, 0.9, -0.9, 2.0 * math.pi])
def test_a_robot_that_stands_as_it_stood_goes_on_soon(turned: float) -> None:
    assert held(turned, RESUMING_FRAMES - 1) is Event.NOTHING
    assert held(turned, RESUMING_FRAMES) is not Event.NOTHING
    assert held(turned, RESUMING_FRAMES, before=math.nan) is not Event.NOTHING  # it never drove


@pytest.mark.parametrize('turned', [1.1, -2.4, math.pi])
def test_one_that_was_turned_has_to_show_it_for_longer(turned: float) -> None:
    """In mirrored images three in a row may agree on a geometry; somebody may turn the robot."""
    assert held(turned, LONG - 1) is Event.NOTHING
    assert held(turned, LONG) is not Event.NOTHING


def seen(state: ServoState, **changes: object) -> float:
    measurement = sight(2, **changes)
    perception = Perception(measurement, fresh_memory(SETTINGS))
    return update(state, perception, 0.1, SETTINGS).measurement.trusted_heading


def test_the_heading_is_that_of_trusted_sights_of_who_drives() -> None:
    driving = in_phase(Phase.MATCHING_FEATURES)
    assert seen(driving) == THERE.heading_error
    known, before = seeing(driving, trusted_heading=THERE.heading_error), THERE.heading_error
    assert seen(known, heading_error=before + 0.5) != before
    assert seen(known, heading_error=before + 1.5) == before
    assert seen(known, bearings=None, parallax=1.0) == before
    held = in_phase(Phase.HOLDING, trusted_heading=0.7)
    assert seen(held) == 0.7
