"""Gains derived on the way: from what the servo sees, where step 1 begins, or a turn first."""

from dataclasses import replace
import math
from typing import Any

import pytest
import servo_states
from servo_states import behind, goal, seeing

from visual_servo_epipolar.core.laws.braking import BRAKING
from visual_servo_epipolar.core.laws.derived_gains import circumstances
from visual_servo_epipolar.core.laws.gains import derive, longest_convergence
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.laws.prediction import BORNE
from visual_servo_epipolar.core.odometry.legs import Slope
from visual_servo_epipolar.core.servo import supervisor as step
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.memory import fresh_memory
from visual_servo_epipolar.core.twoview.perceive import Perception

DERIVED = ServoSettings(law='corrected', gains='derived')
MEMORY = fresh_memory(DERIVED)
PERIOD = 0.1  # between two images [s]


def advance(state: ServoState, measurement: Measurement, settings: ServoSettings) -> ServoState:
    return step.advance(state, Perception(measurement, MEMORY), settings)


def sight(frame: int, current: float, desired: float, **changes: Any) -> Measurement:
    """Return the measurement of a ``frame`` behind the goal, epipoles at these bearings [rad]."""
    there = behind(-desired, current)
    seen = {'bearings': there, 'deviation': math.nan, 'parallax': 0.04, 'feature_error': 0.08}
    return servo_states.sight(frame, **{**seen, 'heading_error': current - desired, **changes})


def after(
    settings: ServoSettings, current: float, desired: float, *, frames: int = 3
) -> ServoState:
    """Return the state after looking from one place for some ``frames``."""
    state = ServoState()
    for frame in range(frames):
        state = advance(state, sight(frame, current, desired), settings)
    return state


@pytest.mark.parametrize('law', ['paper', 'corrected', 'full'])
def test_step_1_begins_with_the_gains_of_what_is_seen_then(law: str) -> None:
    settings = replace(DERIVED, law=law)
    state = after(settings, 0.32, -0.3, frames=2)  # where law full displaces e_au to
    assert state.phase is Phase.ZEROING_EPIPOLES
    start = circumstances(goal(sight(1, 0.32, -0.3), state), state, settings, alpha=0.32)
    assert not start.concordant
    assert (start.current, start.desired) == pytest.approx((0.32, 0.3))
    assert start.rate == pytest.approx(1.0 / PERIOD)
    assert start.landing == settings.latch_engage
    assert start.deceleration == 2.0 * settings.max_acceleration
    assert (start.farthest, start.nearest) == (settings.initial_distance, 1.0)
    assert state.law.gains.k2 == pytest.approx(derive(start).k2)


def test_the_first_step_drives_by_the_derived_gains() -> None:
    state = after(replace(DERIVED, max_linear=1.0, max_angular=1.5), 0.35, -0.3, frames=2)
    gains = state.law.gains
    speed = state.motion.distance * math.hypot(math.tan(0.35), 1.0) / (1.0 + math.tan(0.3) ** 2)
    speed *= gains.k2 * math.tan(0.3) ** gains.exponent / math.tan(0.35)  # eq. (16)
    assert state.twist.linear == pytest.approx(speed)
    # Discordant from behind, e_du < 0 and e_au > 0: both parts of (17) turn the robot.
    turn = gains.k2 * math.tan(0.3) ** gains.exponent * -1.0 / (1.0 + math.tan(0.3) ** 2)
    turn -= gains.k1 * math.tan(0.35) / (1.0 + math.tan(0.35) ** 2)
    assert state.twist.angular == pytest.approx(turn)


def test_once_latched_only_the_delay_limits_k1() -> None:
    state = after(DERIVED, 0.35, -0.3)
    gains = state.law.gains
    landed = advance(state, sight(3, 0.01, 0.0), DERIVED)
    assert landed.law.latched
    assert landed.twist.angular == pytest.approx(-gains.k1_alone * 0.01, rel=1e-3)
    assert gains.k1_alone > gains.k1


def test_law_full_turns_no_faster_than_a_late_image_allows() -> None:
    late = replace(DERIVED, anticipation=False, latency=1.0, turn_gain=5.0, max_angular=0.2)
    state = after(late, 0.32, -0.3, frames=2)
    landed = advance(state, sight(2, 0.01, 0.0), replace(late, max_angular_acceleration=90.0))
    assert landed.law.latched
    assert landed.twist.angular == pytest.approx(-state.law.gains.k1_alone * 0.01, rel=1e-3)
    assert state.law.gains.k1_alone < 0.4


@pytest.mark.parametrize('side', [-1.0, 1.0])
def test_where_no_gain_is_legal_the_robot_turns_to_the_other_sign_first(side: float) -> None:
    state = after(DERIVED, 0.1 * side, 0.3 * side)
    assert state.phase is Phase.DISPLACING
    assert state.law.gains is None
    target = math.atan(state.law.target)
    assert target * side <= -DERIVED.min_displacement
    assert state.twist.angular * side < 0.0  # a right turn takes the image to the left
    there = state
    for frame in (3, 4):
        there = advance(there, sight(frame, target, 0.3 * side), DERIVED)
    assert there.phase is Phase.ZEROING_EPIPOLES
    assert there.law.gains is not None


def test_only_what_turns_illegal_in_the_last_moment_turns_the_robot_after_all() -> None:
    settings = replace(DERIVED, nearest_distance=4.0)
    begun = after(settings, 0.6, 0.2)
    assert (begun.phase, bool(begun.law.gains)) == (Phase.ZEROING_EPIPOLES, True)
    turning = after(settings, 0.6, 0.2, frames=1)
    assert turning.phase is Phase.DISPLACING
    assert math.atan(turning.law.target) == pytest.approx(0.6)
    moved = seeing(turning, target=math.tan(0.2), measurement=sight(0, 0.2, 0.4))
    state = advance(moved, sight(1, 0.2, 0.4), settings)
    assert state.phase is Phase.DISPLACING
    assert state.law.target < 0.0
    assert 'concordant epipoles need' in state.reason


def test_who_looks_ahead_feels_no_more_delay_than_laws_bear() -> None:
    late, soon = (replace(DERIVED, law='full', latency=it) for it in (1.0, BORNE))
    assert after(late, 0.32, -0.3).law.gains == after(soon, 0.32, -0.3).law.gains is not None
    alone = replace(late, anticipation=False)
    assert after(alone, 0.32, -0.3).law.gains != after(soon, 0.32, -0.3).law.gains


@pytest.mark.parametrize('law', [{'law': 'paper'}, {'law': 'corrected'}, {'anticipation': False}])
def test_where_no_turn_helps_the_run_fails_with_the_reason(law) -> None:
    hasty = replace(DERIVED, **law, latency=2.0, max_angular=1.0)
    state = after(hasty, 0.35, -0.3, frames=1)
    assert state.phase is Phase.FAILED
    assert 'one period must be short for the limits' in state.reason
    assert state.twist.linear == state.twist.angular == 0.0


def test_gains_too_slow_for_the_phase_are_a_warning_and_the_reason_why_it_fails() -> None:
    late = replace(DERIVED, law='full', latency=0.3)
    state = after(late, 0.32, -0.3, frames=2)
    assert state.phase is Phase.ZEROING_EPIPOLES
    start = circumstances(goal(sight(1, 0.32, -0.3), state), state, late, alpha=0.32)
    needed = longest_convergence(start, state.law.gains)
    assert needed > late.phase_timeout
    assert state.run.warning.startswith(
        f'derived gains need up to {needed:.0f} s; raise phase_timeout'
    )
    begun_ns = state.run.phase_start_ns - round((late.phase_timeout + 1.0) * 1e9)
    failed = advance(state.changed(phase_start_ns=begun_ns), sight(3, 0.32, -0.3), late)
    assert failed.phase is Phase.FAILED
    assert failed.reason == f'zeroing_epipoles took longer than 120 s: {state.run.warning}'
    assert failed.run.warning == ''


@pytest.mark.parametrize(
    ('changes', 'warns'),
    [
        ({'run_timeout': 200.0}, ' phase_timeout and run_timeout to '),  # of both, where needed
        ({'phase_timeout': 600.0}, ''),
        ({'gains': 'given'}, ''),
    ],
)
def test_only_timeouts_that_are_too_short_are_warned_of(changes, warns: str) -> None:
    late = replace(DERIVED, law='full', latency=0.3, **changes)
    warning = after(late, 0.32, -0.3, frames=2).run.warning
    assert warns in warning and bool(warning) is bool(warns)


def test_a_view_that_leaves_no_room_to_turn_is_a_reason() -> None:
    state = advance(ServoState(), sight(0, 0.1, 0.3, view_margins=(0.01, 0.01)), DERIVED)
    assert state.phase is Phase.FAILED
    assert state.reason == (
        'concordant epipoles need |atan e_au| above 0.48 rad with d_hat_0 / d_0 up to 8, '
        'got 0.07; turn first, best to the other sign'
    )


def test_the_second_step_closes_in_at_its_rate_once_the_slope_of_d_is_known() -> None:
    step_2 = after(DERIVED, 0.35, -0.3).changed(
        phase=Phase.MATCHING_FEATURES, latched=True, settled=0
    )
    gains = step_2.law.gains
    plain = advance(step_2, sight(3, 0.0, 0.0, difference=-0.01), DERIVED)
    assert plain.twist.linear == pytest.approx(0.01 * gains.k_t)
    full = replace(DERIVED, law='full', max_acceleration=20.0)
    sloped = step_2.changed(slope=Slope(0.4, 1e6))
    closing = advance(sloped, sight(3, 0.0, 0.0, difference=-0.01), full)
    rate = min(gains.rate, full.approach_rate)
    assert closing.twist.linear == pytest.approx(0.01 * rate / 0.4, rel=1e-3)


def speed_in_step_2(difference: float, **changes: Any) -> float:
    """Return the speed in step 2 [m/s] of who need not brake, D rising by 0.4 in a metre."""
    settings = replace(ServoSettings(speed_ramps=False, line_following=False), **changes)
    state = ServoState().changed(
        phase=Phase.MATCHING_FEATURES, distance=2.0, slope=Slope(0.4, 1e6)
    )
    for frame in range(2):
        state = advance(state, sight(frame, 0.0, 0.0, difference=difference), settings)
    return state.twist.linear


@pytest.mark.parametrize('way', [0.5, 0.1, 0.02])
def test_whose_accelerations_are_limited_brakes_at_a_constant_deceleration(way: float) -> None:
    braking = {'speed_ramps': True, 'max_acceleration': 20.0, 'latency': 0.0}
    deceleration = BRAKING * 20.0
    speed = speed_in_step_2(-0.4 * way, max_linear=5.0, **braking)
    delay = math.e * PERIOD
    assert speed * delay + speed**2 / (2.0 * deceleration) == pytest.approx(way, rel=1e-3)


def test_a_step_2_without_a_step_1_has_a_derived_k_t_too() -> None:
    settings = replace(DERIVED, scene_depth=6.0)
    start = ServoState().changed(phase=Phase.ORIENTING)
    state = start
    for frame in range(5):
        near = sight(frame, 0.0, 0.0, bearings=None, parallax=0.005, heading_error=0.0)
        state = advance(state, near, settings)
    assert state.phase is Phase.MATCHING_FEATURES
    assert state.law.gains.k_t == pytest.approx(state.law.gains.rate * 6.0 / 0.76)


def test_a_difference_that_underflows_is_no_slope_to_drive_by() -> None:
    state = ServoState().changed(phase=Phase.MATCHING_FEATURES, distance=1.0)
    for frame, difference in enumerate([1e-200, 0.0]):
        seen = sight(frame, 0.0, 0.1, bearings=None, difference=difference, parallax=0.0)
        state = advance(state, seen, replace(DERIVED, law='paper'))
        assert abs(state.twist.linear) <= DERIVED.max_linear


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'finite_time': True}, r'gains cannot be derived for finite_time, eq. \(20\)'),
        ({'nearest_distance': 9.0}, 'nearest_distance must not exceed initial_distance, got 9'),
        ({'gains': 'guessed'}, 'gains must be one of given, derived'),
    ],
)
def test_settings_that_cannot_be_derived_from_are_refused(changes, message) -> None:
    with pytest.raises(ValueError, match=message):
        replace(DERIVED, **changes)
