"""Nobody drives blind for longer than tracks may age: what stops the robot, and what keeps it."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest
from servo_states import BEARINGS, DRIVING, in_phase, PHASES, SETTINGS, sight, then

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.laws.standing import RESUMING_FRAMES
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.run import interrupted, Interruption
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import nominal_twist
from visual_servo_epipolar.core.twoview.measurement import Measurement

FAST = Command(Twist(SETTINGS.max_linear, SETTINGS.max_angular))
FAR = SETTINGS.near_parallax * 2.0
BLIND = {
    'too few features': {'features': SETTINGS.min_features - 1},
    'untrusted far off': {'bearings': None, 'parallax': FAR},
    'nothing ahead': {'bearings': None, 'difference': math.nan, 'parallax': FAR},
}


def at(seconds: float, what: str = '') -> Measurement:
    return replace(sight(**BLIND.get(what, {})), stamp_ns=round(seconds * 1e9))


def at_full_speed(phase: Phase) -> ServoState:
    return in_phase(phase, command=FAST, last_linear=SETTINGS.max_linear, period=0.1)


@pytest.mark.parametrize('phase', [phase for phase in DRIVING if phase is not Phase.ORIENTING])
@pytest.mark.parametrize('what', BLIND)
def test_the_first_blind_image_stops_the_robot_and_no_blind_one_moves_it(phase, what) -> None:
    state = at_full_speed(phase)
    for frame in range(1, 100):
        state = then(state, at(0.1 * frame, what))
        assert state.twist == STANDSTILL
    assert state.phase is Phase.FAILED


def test_orienting_stops_without_features_and_never_drives_off() -> None:
    # A turn in place needs the rotation alone, which matches show without bearings.
    few = then(at_full_speed(Phase.ORIENTING), at(0.1, 'too few features'))
    assert (few.phase, few.twist) == (Phase.HOLDING, STANDSTILL)
    turning = then(in_phase(Phase.ORIENTING), at(0.1, 'untrusted far off'))
    assert turning.twist.linear == 0.0


@given(
    phase=st.sampled_from(DRIVING),
    images=st.lists(
        st.tuples(st.floats(0.02, 3.0), st.sampled_from(['good', *BLIND])), min_size=1, max_size=20
    ),
)
def test_what_is_driven_between_trusted_sight_and_the_stop_is_bounded(phase, images) -> None:
    """The watchdog of the node stands beside: it stops where ``stale_timeout`` is over."""
    state, now, driven = in_phase(phase), 0.0, 0.0
    for gap, what in images:
        obeyed = gap
        if state.phase.drives and gap > SETTINGS.stale_timeout:
            obeyed, before = SETTINGS.stale_timeout, state.twist
            state = interrupted(state, Interruption.LOST, 'no new tracks')
            assert (state.phase, state.twist) == (Phase.HOLDING, STANDSTILL)
            driven += abs(before.linear) * obeyed
        else:
            driven += abs(state.twist.linear) * obeyed
        assert driven <= SETTINGS.max_linear * SETTINGS.stale_timeout + 1e-12
        now += gap
        state = then(state, at(now, what))
        if what == 'good':
            driven = 0.0
        elif state.phase is not Phase.ORIENTING:
            assert state.twist.linear == 0.0


def test_only_trusted_sight_moves_a_robot_that_holds() -> None:
    holding = in_phase(Phase.HOLDING, settled=RESUMING_FRAMES - 1)
    assert then(holding, replace(at(0.1), bearings=BEARINGS)).twist != STANDSTILL
    for what in BLIND:
        state = then(holding, at(0.1, what))
        assert (state.twist, state.settling.settled) == (STANDSTILL, 0)


@pytest.mark.parametrize(
    ('gap', 'counts'),
    [
        (0.1, RESUMING_FRAMES - 1),
        (SETTINGS.stale_timeout - 0.001, RESUMING_FRAMES - 1),
        (SETTINGS.stale_timeout + 0.001, 1),
        (0.0, 1),
        (-0.1, 1),
    ],
)
def test_silence_and_repeated_images_begin_the_count_of_who_holds_anew(gap, counts) -> None:
    holding = in_phase(Phase.HOLDING, settled=RESUMING_FRAMES - 2, measurement=at(3.0))
    state = then(holding, at(3.0 + gap))
    assert (state.phase, state.settling.settled) == (Phase.HOLDING, counts)


def test_images_that_are_refused_begin_it_anew() -> None:
    holding = in_phase(Phase.HOLDING, settled=RESUMING_FRAMES - 1)
    assert interrupted(holding, Interruption.LOST, 'out of order').settling.settled == 0


@pytest.mark.parametrize('phase', PHASES)
def test_before_the_first_image_no_phase_moves_the_robot(phase: Phase) -> None:
    assert nominal_twist(ServoState().changed(phase=phase), SETTINGS) == STANDSTILL


@pytest.mark.parametrize('phase', [Phase.DISPLACING, Phase.ZEROING_EPIPOLES])
def test_without_bearings_there_is_nothing_to_steer_the_epipoles_by(phase: Phase) -> None:
    state = in_phase(phase, measurement=sight(bearings=None), latched=True)
    assert nominal_twist(state, SETTINGS) == STANDSTILL


@pytest.mark.parametrize(
    ('phase', 'bearings'),
    [(Phase.ORIENTING, None), (Phase.ZEROING_EPIPOLES, Bearings(-math.pi / 2.0, math.pi))],
)
def test_step_2_does_not_begin_without_the_difference_that_it_goes_by(phase, bearings) -> None:
    settled = in_phase(phase, settled=SETTINGS.align_frames, latched=True)
    near = sight(bearings=bearings, heading_error=0.0, parallax=0.0)
    begun = then(settled, near)
    assert (begun.phase, begun.settling.settled) == (Phase.MATCHING_FEATURES, 0)  # it settles anew
    blind = then(settled, replace(near, difference=math.nan))
    assert (blind.phase, blind.twist) == (Phase.HOLDING, STANDSTILL)
