"""Tolerances of the owner: held against what is measured and what that may be wrong by."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest
from servo_states import asked, in_phase, seeing, SETTINGS, sight, START
from strategies import floats

from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.arrival import (
    faces_goal,
    FACING,
    facing_bound,
    has_parallax,
    is_at_goal,
    is_near_enough,
)
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.odometry.legs import Slope
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.settling import is_settled
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import classify, switch_phase
from visual_servo_epipolar.core.twoview.measurement import Measurement

SLOPE = 0.13  # of D at the goal, of features about 3 m away [1/m]
OWNERS = replace(SETTINGS, arrival_position=5e-3, arrival_heading=math.radians(0.5))


def near(x: float = 0.0, y: float = 0.0, *, deviation: float = 2e-4, **changes) -> Measurement:
    """Return what a memory of views says ``x`` right and ``y`` ahead of the goal."""
    said = sight(
        bearings=None,
        offset=(x, y),
        offset_deviation=deviation,
        heading_error=0.0,
        heading_deviation=1e-4,
        difference=SLOPE * y,
        difference_deviation=SLOPE * deviation,
        difference_slope=SLOPE,
        parallax=0.4 * SLOPE * math.hypot(x, y),
    )
    return replace(said, **changes)


def by_two_views(y: float, **changes) -> Measurement:
    """Return what two views say ``y`` ahead of the goal."""
    return replace(near(y=y), offset=None, difference_slope=math.nan, **changes)


def ending(measurement: Measurement, **changes) -> ServoState:
    """Return a state in step 2 that has settled, and stands still."""
    mean = {'settled': SETTINGS.arrival_frames, 'settled_parallax': measurement.parallax}
    known = {'phase': Phase.MATCHING_FEATURES, 'measurement': measurement, **mean, **changes}
    return in_phase(**known)


OFFSETS = floats(-0.03, 0.03)
DEVIATIONS = floats(0.0, 0.01)


@given(OFFSETS, OFFSETS, DEVIATIONS, floats(1e-3, 0.02), floats(-0.05, 0.05))
def test_near_enough_is_within_the_tolerance_at_worst(x, y, deviation, tolerance, speed) -> None:
    settings = replace(SETTINGS, arrival_position=tolerance)
    measurement = near(x, y, deviation=deviation)
    state = ending(measurement, command=Command(Twist(speed, 0.0)))
    if asked(is_near_enough, state, measurement, settings):
        assert math.hypot(x, y) + 2.0 * deviation <= tolerance
        assert math.hypot(x, y + speed * settings.latency) + 2.0 * deviation <= tolerance


@given(floats(FACING, 0.1), floats(1.0, 3.0), floats(0.0, 0.01), st.booleans(), st.booleans())
def test_the_bound_of_the_heading_is_within_the_tolerance_and_grows_with_it(
    tolerance: float, factor: float, deviation: float, remembered: bool, lingers: bool
) -> None:
    seen = near(heading_deviation=deviation) if remembered else by_two_views(0.0)
    state = START.changed(time_in_tolerance=math.inf if lingers else 0.0)
    told = replace(SETTINGS, arrival_heading=tolerance)
    bound = asked(facing_bound, state, seen, told)
    assert bound <= tolerance
    if remembered and bound > FACING:
        assert bound + 2.0 * deviation <= tolerance
    coarser = replace(told, arrival_heading=min(factor * tolerance, 0.1))
    assert bound <= asked(facing_bound, state, seen, coarser)


@pytest.mark.parametrize(
    ('phase', 'seen'),
    [
        # A memory of views would be asked for a hundredth of it otherwise, for four seconds.
        (Phase.ORIENTING, near(heading_error=0.007)),
        (Phase.ORIENTING, by_two_views(0.0, heading_error=0.007)),
        (Phase.MATCHING_FEATURES, near(y=-1e-3)),
    ],
)
def test_a_tolerance_has_its_effect_at_once_and_without_it_nothing_is_let_pass(
    phase, seen
) -> None:
    state = ending(seen, phase=phase)
    assert is_settled(state, OWNERS)
    assert not is_settled(state, SETTINGS)
    assert not asked(is_near_enough, state, seen, SETTINGS)


def test_who_would_turn_past_the_tolerance_does_not_face_the_goal() -> None:
    turned = near(heading_error=0.007)
    for rate, faces in ((0.0, True), (-0.05, True), (0.05, False)):
        state = in_phase(Phase.ORIENTING, measurement=turned, command=Command(Twist(0.0, rate)))
        assert asked(faces_goal, state, turned, OWNERS) == faces


@pytest.mark.parametrize(
    ('slope', 'near_enough'),
    [
        (Slope(SLOPE, 0.01), True),
        (Slope(), False),  # no metres without a slope
        (Slope(SLOPE, 1e-8), False),  # nor with one that noise may be
    ],
)
def test_two_views_turn_d_into_metres_by_its_slope(slope: Slope, near_enough: bool) -> None:
    short = by_two_views(-3e-3)
    assert asked(is_near_enough, ending(short, slope=slope), short, OWNERS) == near_enough
    far = by_two_views(-6e-3)
    assert not asked(is_near_enough, ending(far, slope=slope), far, OWNERS)


@pytest.mark.parametrize('remembered', [True, False])
def test_the_way_that_is_left_explains_its_parallax(remembered: bool) -> None:
    """As much of another kind is one too much."""
    coarse, y = replace(SETTINGS, arrival_position=0.1, memory=remembered), -0.06
    seen = near(y=y) if remembered else by_two_views(y)
    state = ending(seen, slope=Slope(SLOPE, 0.01))
    assert asked(is_near_enough, state, seen, coarse)
    assert not asked(is_near_enough, state.changed(settled_parallax=0.1), seen, coarse)


def test_at_the_end_of_step_2_who_is_within_both_tolerances_has_arrived() -> None:
    measurement = near(y=-3e-3, heading_error=0.007)
    assert classify(ending(measurement), OWNERS) is Event.MATCHED
    turned = replace(measurement, heading_error=0.01)
    assert classify(ending(turned), OWNERS) is Event.TURNED


def test_who_arrived_is_not_sent_away_by_noise() -> None:
    """Between the end of step 2 and that of the turn a deviation is let pass."""
    measurement = near(y=-4.7e-3)
    assert not asked(is_near_enough, ending(measurement), measurement, OWNERS)
    assert asked(is_at_goal, in_phase(Phase.ORIENTING), measurement, OWNERS)
    outside = near(y=-4.9e-3)
    assert not asked(is_at_goal, in_phase(Phase.ORIENTING), outside, OWNERS)


def test_a_parallax_within_the_tolerance_alone_is_no_miss_but_leads_on() -> None:
    other = replace(by_two_views(-3e-3), parallax=1e-2)
    without = replace(OWNERS, memory=False)
    state = ending(other, slope=Slope(SLOPE, 0.01))
    assert asked(has_parallax, state, other, without)
    assert not is_settled(state, without)
    assert classify(state, without) is Event.NOTHING
    matched = replace(other, difference=0.0)
    assert classify(seeing(state, measurement=matched), without) is Event.MISSED


@pytest.mark.parametrize('attempt', [1, 4])
def test_no_attempt_makes_a_tolerance_larger(attempt: int) -> None:
    aside = near(x=5.5e-3)
    state = ending(aside, attempts=attempt)
    assert classify(state, OWNERS) is Event.MISSED
    as_near_as_it_can = Event.MATCHED if attempt == 4 else Event.MISSED
    assert classify(state, SETTINGS) is as_near_as_it_can


@pytest.mark.parametrize(
    ('aside', 'deviation', 'missed'),
    [(1.9e-3, 1.5e-3, False), (2.5e-3, 1.5e-3, True), (8e-3, 5e-3, False), (11e-3, 5e-3, True)],
)
def test_what_noise_explains_is_no_miss_where_the_memory_cannot_tell(
    aside: float, deviation: float, missed: bool
) -> None:
    measurement = replace(near(x=aside), offset_deviation=deviation)
    assert (classify(ending(measurement), SETTINGS) is Event.MISSED) is missed
    again = ending(measurement, attempts=2)  # of one that can tell, later ones ask for less
    assert (classify(again, SETTINGS) is Event.MISSED) is (aside > 2.0 * deviation)


@pytest.mark.parametrize(
    ('x', 'y', 'frames', 'event'),
    [
        (8e-3, -5e-3, 5, Event.MISSED),
        (8e-3, -5e-3, 0, Event.NOTHING),  # it drives
        (8e-3, -9e-3, 5, Event.NOTHING),  # on the way there it may still steer
        (1e-3, 0.5e-3, 5, Event.NOTHING),
    ],
)
def test_a_robot_that_stands_beside_the_goal_wastes_no_moves_ahead(x, y, frames, event) -> None:
    seen = near(x=x, y=y)
    state = ending(seen, settled=0, rested=frames, rest=seen if frames else None)
    assert classify(state, SETTINGS) is event
    last = ending(seen, settled=0, rested=frames, rest=seen, attempts=SETTINGS.max_attempts)
    assert classify(last, SETTINGS) is Event.NOTHING


def test_a_tolerance_finer_than_the_noise_is_held_as_measured() -> None:
    fine = replace(SETTINGS, arrival_position=1e-3)
    for x, event in ((0.9e-3, Event.MATCHED), (1.1e-3, Event.MISSED)):
        assert classify(ending(near(x=x, deviation=8e-4)), fine) is event


def test_a_base_that_comes_no_nearer_than_the_tolerance_has_missed() -> None:
    short = near(y=-3e-3)  # within half a hop of its dead band
    for tolerance, event in ((0.0, Event.MATCHED), (4e-3, Event.MATCHED), (1e-3, Event.MISSED)):
        coarse = replace(SETTINGS, arrival_position=tolerance, dead_band_linear=0.07)
        assert classify(ending(short), coarse) is event


@pytest.mark.parametrize('law', [{'law': 'paper'}, {'law': 'corrected'}, {'final_turn': False}])
def test_a_law_without_a_final_turn_has_missed_where_it_is_turned(law) -> None:
    turned = near(heading_error=0.02)
    owners = replace(OWNERS, **law)
    assert classify(ending(turned), owners) is Event.MISSED
    last = ending(turned, attempts=SETTINGS.max_attempts)
    assert classify(last, owners) is Event.EXHAUSTED
    assert (
        'turned by 1.15 deg (arrival_heading)'
        in switch_phase(last, turned, Event.EXHAUSTED, owners).reason
    )
    assert classify(ending(turned), replace(SETTINGS, **law)) is Event.MATCHED
    # Within the tolerance of the place alone it goes on: line following may still turn it.
    short = near(y=-3e-3, heading_error=0.02)
    assert not is_settled(ending(short), owners)
