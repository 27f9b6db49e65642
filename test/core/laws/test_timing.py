"""Stamps that leap: the robot stands for that image, and no limit gets shorter or longer."""

from dataclasses import replace
import math

import pytest
from servo_states import DRIVING, in_phase, PHASES, SETTINGS, sight, then

from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.laws.standing import RESUMING_FRAMES
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import phase_timeout
from visual_servo_epipolar.core.twoview.measurement import Measurement

PERIOD = 0.1
LEAPS = [130.0, -900.0, 1e6]


def at(seconds: float) -> Measurement:
    """Return a good sight from beside the goal, to which the robot backs off for long."""
    return replace(sight(), stamp_ns=round(seconds * 1e9))


def blind(seconds: float) -> Measurement:
    return replace(at(seconds), features=3, bearings=None, reason='3 features')


def driving(
    phase: Phase = Phase.DISPLACING, *, run: float = 0.0, lasted: float = 0.0
) -> ServoState:
    """Return a state at 1000 s whose run and phase have lasted so long [s]."""
    return in_phase(
        phase,
        measurement=at(1000.0),
        period=PERIOD,
        phase_start_ns=round((1000.0 - lasted) * 1e9),
        run_start_ns=round((1000.0 - run) * 1e9),
        command=Command(Twist(0.1, 0.1)),
    )


@pytest.mark.parametrize('phase', DRIVING)
@pytest.mark.parametrize('leap', LEAPS)
def test_who_drives_stands_for_the_image_that_leaps_and_goes_on(phase: Phase, leap: float) -> None:
    state = then(driving(phase), at(1000.1 + leap))
    assert (state.phase, state.twist) == (Phase.HOLDING, STANDSTILL)
    ahead = f'no image for {leap + 0.1:.1f} s by their stamps'
    assert state.reason == (
        ahead if leap > 0.0 else 'the stamps do not advance; is /clock published?'
    )
    for number in range(1, RESUMING_FRAMES):
        state = then(state, at(1000.1 + 0.1 * number + leap))
        assert (state.phase, state.twist) == (Phase.HOLDING, STANDSTILL)
    state = then(state, at(1000.1 + 0.1 * RESUMING_FRAMES + leap))
    assert state.phase.drives
    assert state.twist != STANDSTILL


@pytest.mark.parametrize('leap', LEAPS)
@pytest.mark.parametrize(('left', 'fails'), [(0.15, False), (0.05, True)])
def test_a_leap_counts_as_one_period_of_the_run(leap: float, left: float, fails: bool) -> None:
    state = then(driving(run=SETTINGS.run_timeout - left), at(1000.1 + leap))
    assert (state.phase is Phase.FAILED) == fails
    assert state.twist == STANDSTILL
    if not fails:
        # 0.05 s are left, and no more than the next image takes them.
        state = then(state, at(1000.2 + leap))
        assert state.phase is Phase.FAILED
        assert state.reason == 'the run took longer than 600 s, still holding'


def test_a_stamp_that_runs_back_again_and_again_does_not_prolong_the_run() -> None:
    state = driving(run=SETTINGS.run_timeout - 10.0)
    for frame in range(1, 200):
        state = then(state, at(1000.0 - 3.0 * frame))
        if state.phase is Phase.FAILED:
            break
    assert state.phase is Phase.FAILED
    assert frame <= 102


@pytest.mark.parametrize('leap', [0.0, -900.0])
def test_who_holds_does_not_wait_longer_for_stamps_that_stand_or_run_back(leap: float) -> None:
    state = then(driving(), blind(1000.1))
    assert state.phase is Phase.HOLDING
    for frame in range(1, 100):
        state = then(state, blind(1000.1 + frame * leap))
        if state.phase is Phase.FAILED:
            break
    assert state.reason.startswith('tracks lost or untrusted for 5 s')
    assert 50 <= frame <= 52


@pytest.mark.parametrize(
    ('gap', 'stale', 'held'),
    [(1.0, 0.5, False), (1.01, 0.5, True), (3.0, 3.0, False), (3.01, 3.0, True)],
)
def test_a_leap_is_longer_than_a_second_and_than_tracks_may_age(gap, stale, held) -> None:
    state = then(driving(), at(1000.0 + gap), replace(SETTINGS, stale_timeout=stale))
    assert (state.phase is Phase.HOLDING) == held


@pytest.mark.parametrize('leap', LEAPS)
def test_a_leap_teaches_nothing_and_ends_no_phase_that_has_time_left(leap: float) -> None:
    lasted = SETTINGS.phase_timeout - 1.0
    before = driving(Phase.ZEROING_EPIPOLES, lasted=lasted).changed(distance=5.0)
    state = then(before, at(1000.1 + leap))
    assert state.phase is Phase.HOLDING
    assert (state.motion.distance, state.view.period, state.run.travel) == (5.0, PERIOD, 0.0)
    assert state.identified.curvature.value == 0.0
    assert math.isnan(state.motion.slope.value)


def test_before_a_period_is_known_a_leap_counts_as_a_tenth_of_a_second() -> None:
    fresh = driving(run=SETTINGS.run_timeout - 0.11).changed(period=math.nan)
    assert then(fresh, at(1130.0)).phase is Phase.HOLDING
    late = driving(run=SETTINGS.run_timeout - 0.09).changed(period=math.nan)
    assert then(late, at(1130.0)).phase is Phase.FAILED


def test_who_holds_counts_what_the_stamps_say_while_they_advance() -> None:
    # He stands, and cannot tell a clock that was set from a camera that was silent.
    state = then(driving(), blind(1000.1))
    assert then(state, at(1005.0)).phase is Phase.HOLDING
    assert then(state, at(1005.2)).phase is Phase.FAILED


@pytest.mark.parametrize('leap', LEAPS)
def test_who_drove_too_far_backward_has_failed_also_by_an_image_that_leaps(leap: float) -> None:
    far = driving(Phase.RETREATING).changed(reversed=SETTINGS.max_retreat + 1.0)
    state = then(far, at(1000.1 + leap))
    assert (state.phase, state.twist) == (Phase.FAILED, STANDSTILL)
    assert 'max_retreat' in state.reason


@pytest.mark.parametrize('phase', [phase for phase in PHASES if not phase.drives])
def test_who_stands_takes_no_step_by_a_stamp_that_does_not_advance(phase: Phase) -> None:
    state = then(driving(phase), at(1000.0))
    assert (state.phase, state.twist) == (phase, STANDSTILL)


def test_a_turn_that_swings_about_its_aim_ends_after_some_turns() -> None:
    """Through a lens told wrong a turn looks larger than it is; nobody waits for two minutes."""
    assert then(driving(lasted=19.9), at(1000.1)).phase is not Phase.FAILED
    bare = replace(SETTINGS, law='corrected')
    assert then(driving(lasted=20.2), at(1000.1), bare).phase is not Phase.FAILED
    state = then(driving(lasted=20.2), at(1000.1))
    assert state.reason.startswith(
        'displacing took longer than 20.1 s: the robot turns to and fro'
    )


def test_a_base_that_speeds_up_slowly_has_the_time_that_it_needs_for_a_turn() -> None:
    slow = replace(SETTINGS, max_angular=2.0, max_angular_acceleration=0.1)
    assert phase_timeout(Phase.DISPLACING, slow) > 3.0 * 2.0 * math.sqrt(math.pi / 0.1)
