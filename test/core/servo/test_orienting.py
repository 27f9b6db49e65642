"""A turn in place at the least baseline: one heading, whichever way an image measures it."""

from dataclasses import replace
import math

import pytest
from servo_states import in_phase, SETTINGS, sight, then

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.twoview.measurement import Measurement

BIAS = 0.017  # of the best rotation, as a baseline of 0.1 m at 6 m depth shows
BESIDE = math.pi / 2.0  # the goal is to the left


def with_bearings(frame: int, heading: float) -> Measurement:
    bearings = Bearings(math.pi, BESIDE - heading)
    near = sight(frame, bearings=bearings, difference=0.0, parallax=2.52 / 769.0)
    return replace(near, heading_error=heading, rotation_heading=heading - BIAS)


def without(frame: int, heading: float) -> Measurement:
    near = sight(frame, bearings=None, difference=0.0, parallax=2.48 / 769.0)
    return replace(near, heading_error=heading - BIAS, rotation_heading=heading - BIAS)


def test_a_heading_that_flickers_at_the_least_parallax_is_one_heading() -> None:
    state, heading = in_phase(Phase.ORIENTING), 0.05
    for frame in range(1, 400):
        seen = (with_bearings, without)[frame % 2](frame, heading)
        state = then(state, seen)
        if state.phase is not Phase.ORIENTING:
            break
        heading += 0.1 * state.twist.angular
    assert state.phase in (Phase.RETREATING, Phase.MATCHING_FEATURES)
    assert abs(heading) < 2.0 * SETTINGS.arrival_heading
    assert frame < 150


@pytest.mark.parametrize(
    ('sights', 'heading'),
    [
        ([with_bearings(1, 0.05), without(2, 0.03)], 0.03),  # it holds for the images after it
        # Bearings that are noisy are averaged.
        ([with_bearings(1, 0.05), replace(with_bearings(2, 0.05), heading_error=0.06)], 0.052),
        ([without(1, 0.05)], 0.05 - BIAS),  # until bearings show it the rotation is believed
    ],
)
def test_what_bearings_show_of_the_rotation_counts(sights, heading) -> None:
    state = in_phase(Phase.ORIENTING)
    for seen in sights:
        state = then(state, seen)
    assert state.measurement.heading_error == pytest.approx(heading)


def test_another_phase_measures_for_itself() -> None:
    state = in_phase(Phase.MATCHING_FEATURES, rotation_bias=0.5)
    state = then(state, without(1, 0.05))
    assert state.measurement.heading_error == pytest.approx(0.05 - BIAS)
    assert math.isnan(state.view.rotation_bias)


@pytest.mark.parametrize(('difference', 'phase'), [(-0.01, 'retreating'), (-0.07, 'displacing')])
def test_a_baseline_found_too_near_the_goal_is_made_longer_first(difference, phase) -> None:
    # A displacement there would lose it again, for ever.
    facing = replace(
        sight(bearings=Bearings(-math.pi / 2.0 - 0.15, math.pi - 0.15), difference=difference),
        heading_error=0.0,
    )
    state = then(in_phase(Phase.ORIENTING, settled=SETTINGS.align_frames), facing)
    assert state.phase.value == phase


def test_a_step_of_the_difference_where_bearings_appear_is_no_slope() -> None:
    # It is compensated by their rotation then, before by the best one: no way has led there.
    slow = {'command': Command(Twist(-0.001, 0.0)), 'last_linear': -0.001}
    without = sight(0, bearings=None, difference=0.006, heading_error=0.0, parallax=0.004)
    state = in_phase(Phase.MATCHING_FEATURES, measurement=without, **slow)
    seen = sight(difference=-0.03, parallax=0.004)
    assert math.isnan(then(state, seen).motion.slope.value)
    alike = in_phase(Phase.MATCHING_FEATURES, measurement=sight(0, difference=-0.0301), **slow)
    assert math.isfinite(then(alike, seen).motion.slope.value)
