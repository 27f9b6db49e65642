"""One control step: what the servo does with what it sees, and that it stops when in doubt."""

from dataclasses import replace
import math
from typing import Any

from hypothesis import example, given
from hypothesis import strategies as st
import pytest
import servo_states
from servo_states import behind, DRIVING, PHASES, seeing, sight
from strategies import bearings, floats

from visual_servo_epipolar.core.estimate.settings import DEPARTURES
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.laws.conditions import displacement
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo import supervisor as servo_step
from visual_servo_epipolar.core.servo.run import interrupted, Interruption
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import nominal_twist, phase_timeout
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.memory import fresh_memory
from visual_servo_epipolar.core.twoview.perceive import Perception

# Accelerations as good as unlimited: what the laws ask for shows at once.
SETTINGS = ServoSettings(
    law='full', max_acceleration=20.0, max_angular_acceleration=90.0, memory=False
)
MEMORY = fresh_memory(SETTINGS)
QUIET = (Phase.WAITING, Phase.HOLDING, Phase.ARRIVED, Phase.FAILED)
LAWS = st.builds(
    lambda law, out: {'law': law, **dict.fromkeys(out, False)},
    st.sampled_from(['paper', 'corrected', 'full']),
    st.sets(st.sampled_from(sorted(DEPARTURES))),
)


step = servo_step.step


def advance(state: ServoState, measurement: Measurement, settings: ServoSettings) -> ServoState:
    return servo_step.advance(state, Perception(measurement, MEMORY), settings)


def stamp(seconds: float) -> int:
    return round(seconds * 1e9)


def measurement(
    seconds: float = 0.0, *, current: float = 0.2, desired: float = -0.3, **changes: Any
) -> Measurement:
    """Return a good measurement from behind the goal, epipoles at these bearings [rad]."""
    good = sight(bearings=behind(-desired, current), deviation=math.nan, heading_error=0.1)
    return replace(good, stamp_ns=stamp(seconds), **changes)


def seen(*seconds: float) -> list[Measurement]:
    """Return good measurements at these times [s]."""
    return [measurement(item) for item in seconds]


def blind(seconds: float) -> Measurement:
    return Measurement(stamp(seconds), 3, 769.0, 0.3, reason='3 features, 12 needed')


def at_goal(seconds: float) -> Measurement:
    return measurement(
        seconds,
        bearings=None,
        parallax=0.1 / 769.0,
        feature_error=0.1 / 769.0,
        difference=0.0,
        heading_error=0.0,
    )


def after(
    *sights: Measurement, state: ServoState | None = None, settings: ServoSettings = SETTINGS
) -> ServoState:
    """Return the state after ``sights``, from ``state`` or from the beginning."""
    state = state or ServoState()
    for each in sights:
        state = advance(state, each, settings)
    return state


def in_phase(phase: Phase, **changes: Any) -> ServoState:
    """Return a state at time zero in ``phase``, as a run would have it."""
    return servo_states.in_phase(phase, **{'measurement': measurement(), 'mount': None, **changes})


def sights() -> st.SearchStrategy[Measurement]:
    """Whatever `perceive` may return: blank, without bearings, or complete."""
    complete = st.builds(
        Measurement,
        stamp_ns=st.integers(0, stamp(10.0)),
        features=st.integers(SETTINGS.min_features, 60),
        focal=st.just(769.0),
        noise_px=st.just(0.3),
        bearings=st.none() | bearings(),
        confidence=floats(0.0, 1.0),
        inliers=st.integers(8, 60),
        parallax=floats(0.0, 1.0),
        heading_error=floats(-math.pi, math.pi),
        difference=floats(-5.0, 5.0) | st.just(math.nan),  # nan: nothing is ahead
        deviation=floats(0.0, 0.5) | st.just(math.nan),
        view_margins=st.tuples(floats(0.0, 3.0), floats(0.0, 3.0)),
        feature_error=floats(0.0, 2.0),
        reason=st.sampled_from(['', 'cheirality vote undecided']),
    )
    return st.integers(0, 10).map(blind) | complete


def states() -> st.SearchStrategy[ServoState]:
    flat = st.fixed_dictionaries(
        {
            'phase': st.sampled_from(PHASES),
            'phase_start_ns': st.integers(0, stamp(10.0)),
            'command': st.builds(Command, st.builds(Twist, floats(-0.4, 0.4), floats(-0.5, 0.5))),
            'measurement': sights(),
            'distance': floats(SETTINGS.min_distance, 50.0),
            'target': floats(-0.4, 0.4),
            'side': st.sampled_from([-1.0, 1.0]),
            'latched': st.booleans(),
            'settled': st.integers(0, 10),
            'attempts': st.integers(1, 3),
            'frame': st.integers(0, 1000),
        }
    )
    return flat.map(lambda fields: seeing(ServoState(), **fields))


NOTHING_AHEAD = measurement(0.1, bearings=None, difference=math.nan)
ALIGNED_BLINDLY = measurement(0.1, bearings=Bearings(0.0, 0.0), difference=math.nan)
KINDS = [{}, {'finite_time': True}, {'gains': 'derived'}]
INFINITE = measurement(0.1, bearings=Bearings(0.0, 0.3))  # e_du at infinity: cot(0)


def test_a_servo_that_waits_says_for_what_and_does_not_give_up() -> None:
    few = after(blind(0.0), blind(400.0), blind(700.0))
    assert (few.phase, few.command) == (Phase.WAITING, ServoState().command)
    assert few.reason == 'no feature of the photograph is in view for certain: 3 found, 12 needed'
    none = after(replace(blind(700.1), features=0), state=few)
    assert none.reason == 'no feature of the photograph is in view'
    seen = after(measurement(700.2), state=none)
    assert seen.phase is Phase.DISPLACING
    assert seen.reason == 'apart'


@given(states(), sights(), LAWS, st.sampled_from(KINDS), floats(0.0, 2.0))
@example(in_phase(Phase.DISPLACING), INFINITE, {'law': 'corrected'}, {}, 0.0)
@example(in_phase(Phase.ZEROING_EPIPOLES), INFINITE, {}, {}, 0.0)
@example(in_phase(Phase.ORIENTING, settled=9), NOTHING_AHEAD, {'law': 'paper'}, {}, 0.0)
@example(in_phase(Phase.ZEROING_EPIPOLES, settled=9), ALIGNED_BLINDLY, {}, {}, 0.0)
def test_no_sight_breaks_limits_stirs_a_quiet_phase_or_raises(
    state, sight, law, kind, latency
) -> None:
    settings, before = replace(SETTINGS, **law, **kind, latency=latency), repr(state)
    then = advance(state, sight, settings)  # a Twist is finite, or does not exist
    assert abs(then.twist.linear) <= settings.max_linear * (1.0 + 1e-15)
    assert abs(then.twist.angular) <= settings.max_angular * (1.0 + 1e-15)
    assert then.phase not in QUIET or then.twist == STANDSTILL
    assert then.motion.distance >= SETTINGS.min_distance
    # The step is pure; by text: nan is not equal to nan.
    assert repr(state) == before
    assert repr(then) == repr(advance(state, sight, settings))


def test_d_hat_starts_at_its_floor_if_told_to_start_below() -> None:
    settings = ServoSettings(law='full', initial_distance=0.1, min_distance=0.3)
    assert after(measurement(), settings=settings).motion.distance >= settings.min_distance


def test_law_full_displaces_the_current_epipole_to_the_discordant_side() -> None:
    state = after(measurement(current=0.2, desired=0.3))
    assert state.law.target < 0.0
    assert state.twist.linear == 0.0
    assert state.twist.angular < 0.0  # e_au' has the sign of the turn, eq. (9)


@pytest.mark.parametrize('law', ['paper', 'corrected'])
def test_the_bare_laws_displace_a_current_epipole_that_is_zero_alone(law: str) -> None:
    settings = replace(SETTINGS, law=law)
    apart = after(measurement(), measurement(0.1), settings=settings)
    assert apart.phase is Phase.ZEROING_EPIPOLES
    state = after(measurement(current=1e-3), measurement(0.1, current=1e-3), settings=settings)
    assert state.phase is Phase.DISPLACING
    assert state.twist.linear == 0.0
    assert state.twist.angular > 0.0


@pytest.mark.parametrize(('law', 'sign'), [('full', -1.0), ('corrected', -1.0), ('paper', 1.0)])
def test_the_sign_of_the_first_step_is_that_of_the_law(law: str, sign: float) -> None:
    # Concordant behind the goal: sigma is -1, the printed sign is +1.
    state = in_phase(Phase.ZEROING_EPIPOLES, measurement=measurement(desired=0.3), side=1.0)
    twist = nominal_twist(state, replace(SETTINGS, law=law))
    assert twist.linear * sign > 0.0


@pytest.mark.parametrize('finite', [False, True])
def test_the_first_step_is_the_law_of_the_paper(finite: bool) -> None:
    settings = replace(
        SETTINGS, law='corrected', max_linear=5.0, max_angular=10.0, finite_time=finite
    )
    sight = measurement(0.1)
    e_au, e_du = sight.bearings.epipole_current, sight.bearings.epipole_desired
    controls = equations.finite_time_controls if finite else equations.auxiliary_controls
    nu = controls(e_au, e_du, k1=settings.k1, k2=settings.k2, exponent=settings.exponent)
    expected = equations.linearizing_control(
        e_au, e_du, sigma=sight.bearings.sigma, distance=8.0, nu=nu
    )
    assert (
        after(sight, state=in_phase(Phase.ZEROING_EPIPOLES), settings=settings).twist == expected
    )


def test_d_hat_is_updated_by_the_speed_that_was_applied() -> None:
    state = in_phase(Phase.ZEROING_EPIPOLES, command=Command(Twist(0.25, 0.0)))
    distance = after(measurement(0.5), state=state).motion.distance
    # (18) for half a second towards the goal, 0.2 rad off the baseline.
    assert distance == pytest.approx(8.0 - 0.5 * 0.25 * math.cos(0.2))


def test_a_long_gap_is_not_integrated_over() -> None:
    state = in_phase(Phase.ZEROING_EPIPOLES, command=Command(Twist(0.25, 0.0)))
    longest = 8.0 - 0.25 * math.cos(0.2)
    assert after(measurement(1.0), state=state).motion.distance == pytest.approx(longest)
    assert after(measurement(1.01), state=state).motion.distance == 8.0
    patient = replace(SETTINGS, stale_timeout=40.0)
    slow = after(measurement(30.0), state=state, settings=patient)
    assert slow.motion.distance == pytest.approx(longest)


def test_both_epipoles_at_zero_begin_the_second_step() -> None:
    aligned = [measurement(0.1 * k, current=1e-4, desired=1e-4) for k in range(1, 6)]
    state = after(*aligned[: SETTINGS.align_frames - 1], state=in_phase(Phase.ZEROING_EPIPOLES))
    assert state.phase is Phase.ZEROING_EPIPOLES
    assert after(aligned[-1], state=state).phase is Phase.MATCHING_FEATURES


def test_features_that_match_for_long_enough_are_an_arrival() -> None:
    frames = [at_goal(0.1 * k) for k in range(1, SETTINGS.arrival_frames + 1)]
    before = after(*frames[:-1], state=in_phase(Phase.MATCHING_FEATURES))
    assert before.phase is Phase.MATCHING_FEATURES
    state = after(frames[-1], state=before)
    assert state.phase is Phase.ARRIVED
    assert state.twist == STANDSTILL
    assert state.ended
    # One frame that does not match starts the count anew.
    state = after(measurement(0.5), at_goal(0.6), state=before)
    assert (state.phase, state.settling.settled) == (Phase.MATCHING_FEATURES, 1)


def test_a_miss_backs_off_for_another_attempt_and_fails_in_the_last() -> None:
    frames = [
        replace(at_goal(0.1 * k), parallax=2.0 / 769.0, feature_error=20.0 / 769.0)
        for k in range(1, SETTINGS.arrival_frames + 1)
    ]
    state = after(*frames, state=in_phase(Phase.MATCHING_FEATURES))
    assert (state.phase, state.run.attempts) == (Phase.RETREATING, 2)
    assert state.twist.linear == pytest.approx(-SETTINGS.retreat_speed)
    last = in_phase(Phase.MATCHING_FEATURES, attempts=SETTINGS.max_attempts)
    state = after(*frames, state=last)
    assert state.phase is Phase.FAILED
    assert '20.0 px off' in state.reason


def test_at_the_goal_already_the_robot_does_not_move() -> None:
    state = after(at_goal(0.0))
    assert (state.phase, state.twist) == (Phase.ARRIVED, STANDSTILL)


def test_a_pure_rotation_is_turned_back_and_left_to_the_second_step() -> None:
    state = after(replace(at_goal(0.0), feature_error=60.0 / 769.0, heading_error=0.1))
    assert state.phase is Phase.ORIENTING
    assert state.twist.linear == 0.0
    assert state.twist.angular < 0.0
    turned = [
        replace(at_goal(0.1 * k), difference=-0.01) for k in range(1, SETTINGS.align_frames + 1)
    ]
    assert after(*turned, state=state).phase is Phase.MATCHING_FEATURES


def test_the_displaced_epipole_keeps_the_features_in_view() -> None:
    free = measurement(current=0.1, desired=-0.2)
    assert displacement(free, SETTINGS) == pytest.approx(0.215, abs=0.001)
    # e_au moves right when the camera turns left.
    tight = replace(free, view_margins=(0.05, math.inf))
    assert displacement(tight, SETTINGS) == pytest.approx(0.15)


def test_without_room_for_a_useful_turn_the_robot_backs_off_first() -> None:
    tight = measurement(current=-0.1, desired=-0.2, view_margins=(0.15, math.inf))
    assert displacement(tight, SETTINGS) is None
    assert after(tight).phase is Phase.RETREATING


def test_backing_off_turns_no_further_than_the_view_allows() -> None:
    beside = measurement(
        0.1, current=0.3, desired=-1.2, heading_error=-0.8, view_margins=(0.2, math.inf)
    )
    slow = replace(SETTINGS, speed_ramps=False)
    turning = after(beside, settings=slow, state=in_phase(Phase.RETREATING)).twist
    assert turning.angular == pytest.approx(0.2 * SETTINGS.turn_gain)
    assert turning.linear == 0.0
    blocked = replace(beside, view_margins=(0.01, math.inf))
    assert after(blocked, state=in_phase(Phase.RETREATING)).twist.linear < 0.0


@pytest.mark.parametrize(
    ('desired', 'latched'),
    [
        (-0.9 * SETTINGS.latch_engage, True),
        (+0.9 * SETTINGS.latch_release, True),  # it has crossed zero
        (-0.9 * SETTINGS.latch_release, False),
    ],
)
def test_the_latch_engages_at_zero_and_stops_translation(desired: float, latched: bool) -> None:
    seen = measurement(0.1, desired=desired)
    state = after(seen, state=in_phase(Phase.ZEROING_EPIPOLES))
    assert (state.law.latched, state.twist.linear == 0.0) == (latched, latched)


@given(st.lists(floats(-0.99, 0.99), min_size=1, max_size=20))
def test_the_latch_holds_all_the_way_up_to_its_release(parts: list[float]) -> None:
    latched = in_phase(Phase.ZEROING_EPIPOLES, latched=True)
    noisy = [
        measurement(0.1 * k, desired=part * SETTINGS.latch_release)
        for k, part in enumerate(parts, 1)
    ]
    state = after(*noisy, state=latched)
    assert state.law.latched
    assert state.phase is Phase.ZEROING_EPIPOLES
    assert state.twist.linear == 0.0


def test_law_full_brakes_before_the_desired_epipole_is_zero() -> None:
    running = in_phase(Phase.ZEROING_EPIPOLES, measurement=measurement(0.0, desired=-0.05))
    slow = after(measurement(0.1, desired=-0.0499), state=running)
    fast = after(measurement(0.1, desired=-0.03), state=running)
    assert abs(fast.twist.linear) < abs(slow.twist.linear)


@pytest.mark.parametrize('phase', DRIVING)
def test_tracks_that_come_back_resume_the_run(phase: Phase) -> None:
    state = after(blind(0.1), blind(0.2), *seen(0.3, 0.4), state=in_phase(phase))
    assert (state.phase, state.twist) == (Phase.HOLDING, STANDSTILL)
    again = after(blind(0.5), *seen(0.6, 0.7), state=state)
    assert (again.phase, again.twist) == (Phase.HOLDING, STANDSTILL)
    for held in (state, again):
        resumed = after(measurement(0.8), state=held)
        assert resumed.phase is Phase.DISPLACING
        assert resumed.twist != STANDSTILL


@pytest.mark.parametrize('phase', DRIVING)
def test_a_phase_that_takes_too_long_fails_with_its_name(phase: Phase) -> None:
    most = phase_timeout(phase, SETTINGS)
    running = in_phase(phase, measurement=measurement(most - 0.1))
    assert after(measurement(most - 0.01), state=running).phase is not Phase.FAILED
    state = after(measurement(most + 0.1), state=running)
    assert (state.phase, state.twist) == (Phase.FAILED, STANDSTILL)
    assert state.reason.startswith(f'{phase.value} took longer than ')


@pytest.mark.parametrize('phase', PHASES)
def test_a_stop_leaves_a_fresh_servo_at_a_standstill(phase: Phase) -> None:
    state = interrupted(
        in_phase(phase, command=Command(Twist(0.3, 0.1)), frame=9), Interruption.STOPPED
    )
    assert state.phase is Phase.WAITING
    assert state.twist == STANDSTILL
    assert math.isnan(state.motion.distance)
    assert state.view.frame == 9


@pytest.mark.parametrize('phase', [Phase.RETREATING, Phase.WAITING])
def test_a_robot_that_backs_off_or_begins_by_its_bearings_needs_no_d(phase: Phase) -> None:
    state = after(measurement(0.1, difference=math.nan), state=in_phase(phase))
    assert state.phase.drives, state.reason


def test_a_robot_that_closes_in_by_d_and_has_none_holds_and_says_why() -> None:
    state = after(measurement(0.1, difference=math.nan), state=in_phase(Phase.MATCHING_FEATURES))
    assert (state.phase, state.twist) == (Phase.HOLDING, STANDSTILL)
    assert state.reason == 'no feature is ahead in both views'


def test_a_gap_in_a_long_phase_counts_from_the_last_tracks_on() -> None:
    long = SETTINGS.holding_timeout + 20.0
    state = in_phase(Phase.ZEROING_EPIPOLES, measurement=measurement(long))
    state = interrupted(state, Interruption.LOST, 'no new tracks for 0.6 s')
    assert state.phase is Phase.HOLDING
    assert after(*seen(long + 0.7, long + 0.8, long + 0.9), state=state).phase.drives
    silence = SETTINGS.holding_timeout + 0.1
    assert advance(state, measurement(long + silence), SETTINGS).phase is Phase.FAILED
