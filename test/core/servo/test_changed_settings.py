"""Settings changed while the robot drives hold from the next command on."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import pytest
from servo_states import DRIVING, in_phase, SETTINGS, sight, then
from strategies import floats

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import nominal_twist
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings

DERIVED = ServoSettings(gains='derived', law='full')
ALIGNED = Bearings(-math.pi / 2.0, math.pi)
STEPS = (Phase.ZEROING_EPIPOLES, Phase.MATCHING_FEATURES)


@given(
    phase=st.sampled_from(DRIVING),
    last=st.builds(Twist, floats(-0.4, 0.4), floats(-0.5, 0.5)),
    max_linear=floats(0.01, 0.4),
    max_angular=floats(0.01, 0.5),
)
def test_a_limit_lowered_while_driving_holds_at_once(phase, last, max_linear, max_angular) -> None:
    lowered = replace(SETTINGS, max_linear=max_linear, max_angular=max_angular)
    twist = then(in_phase(phase, command=Command(last)), settings=lowered).twist
    assert abs(twist.linear) <= max_linear * (1.0 + 1e-15)
    assert abs(twist.angular) <= max_angular * (1.0 + 1e-15)


def begun(settings: ServoSettings, phase: Phase) -> ServoState:
    """Return a state in ``phase`` whose gains were derived as it began."""
    if phase is Phase.ZEROING_EPIPOLES:
        return then(in_phase(Phase.DISPLACING, target=0.2, period=0.1), sight(), settings)
    zeroed = {'latched': True, 'settled': SETTINGS.align_frames, 'period': 0.1}
    seen = sight(bearings=ALIGNED, difference=-0.005)
    return then(in_phase(Phase.ZEROING_EPIPOLES, **zeroed), seen, settings)


@pytest.mark.parametrize('phase', STEPS)
def test_given_gains_hold_as_soon_as_derived_ones_are_given_up(phase: Phase) -> None:
    state = begun(DERIVED, phase)
    assert state.phase is phase
    assert state.law.gains is not None
    given_up = replace(DERIVED, gains='given')
    fresh = state.changed(gains=None)
    assert nominal_twist(state, given_up) == nominal_twist(fresh, given_up)
    assert nominal_twist(state, given_up) != nominal_twist(state, DERIVED)


def test_gains_that_were_given_up_are_not_taken_up_again_by_the_next_phase() -> None:
    state = then(
        begun(DERIVED, Phase.ZEROING_EPIPOLES).changed(settled=9, latched=True),
        sight(2, bearings=ALIGNED),
        replace(DERIVED, gains='given'),
    )
    assert (state.phase, state.law.gains) == (Phase.MATCHING_FEATURES, None)


def test_a_focal_length_is_not_left_to_an_estimator_that_cannot_learn_it() -> None:
    with pytest.raises(ValueError, match=r'with estimator lmeds_8pt, .* got 0\.3; soft_planar'):
        PerceptionSettings(estimator='lmeds_8pt', focal_deviation=0.3)
    assert PerceptionSettings(estimator='lmeds_8pt').calibrated
    assert not PerceptionSettings(focal_deviation=0.3).calibrated
