"""No phase leads farther or lasts longer than it may, also where stamps leap."""

from dataclasses import replace
import math
from typing import Any

import pytest
from servo_states import (
    asked,
    BEARINGS,
    DRIVING,
    estimated,
    in_phase,
    PHASES,
    ranged,
    seeing,
    SETTINGS,
    sight,
    STEPS,
    then,
)

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.conditions import excursion_limit
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.standing import RESUMING_FRAMES
from visual_servo_epipolar.core.odometry.legs import Leg
from visual_servo_epipolar.core.rigs.rig import Command, HALT
from visual_servo_epipolar.core.servo.run import interrupted, Interruption
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import classify, phase_timeout
from visual_servo_epipolar.core.twoview.measurement import Measurement


@pytest.mark.parametrize('phase', [*DRIVING, Phase.HOLDING])  # also while tracks are lost
def test_who_drives_backward_too_far_fails_and_says_so(phase: Phase) -> None:
    state = then(in_phase(phase, reversed=20.01))
    assert (state.phase, state.twist) == (Phase.FAILED, STANDSTILL)
    assert state.reason == f'drove 20.0 m backward in this run (max_retreat), still {phase.value}'
    assert then(in_phase(phase, reversed=19.99)).phase is not Phase.FAILED


@pytest.mark.parametrize(
    ('changes', 'most'),
    [
        ({'law': 'paper'}, 30.0),  # laws that lead away by themselves: half as far again
        ({'law': 'corrected'}, 30.0),
        ({'retreat': False}, 30.0),
        ({'max_retreat': 0.0}, 0.1),  # small corrections are no backing off
    ],
)
def test_how_far_backward_a_law_may_drive(changes, most) -> None:
    settings = replace(SETTINGS, **changes)
    for phase, driven, ends in ((STEPS[0], 0.99, False), (STEPS[1], 1.01, True)):
        limit = asked(excursion_limit, in_phase(phase, reversed=driven * most), sight(), settings)
        assert ('backward in this run (max_retreat)' in limit) is ends


SIDEWAYS = sight(bearings=Bearings(-0.3, -0.3 - math.pi / 2.0), difference=0.1)


def backing_off(settings: ServoSettings, *, frames: int = 60, **changes: Any) -> ServoState:
    """Return the state after ``frames`` beside the goal, or when it has failed."""
    state = in_phase(Phase.RETREATING, measurement=replace(SIDEWAYS, stamp_ns=0), **changes)
    for frame in range(1, frames):
        state = then(state, replace(SIDEWAYS, stamp_ns=frame * 100_000_000), settings)
        if state.phase is Phase.FAILED:
            break
    return state


def test_what_former_attempts_drove_backward_counts_as_well() -> None:
    settings = replace(SETTINGS, max_retreat=0.5)
    assert backing_off(settings, reversed=0.4).view.frame < 20
    missed = in_phase(Phase.MATCHING_FEATURES, reversed=0.4, travel=-0.4)
    there = sight(difference=0.0, heading_error=0.0)
    state = then(missed.changed(settled=3 * SETTINGS.arrival_frames, settled_parallax=1.0), there)
    assert (state.phase, state.run.attempts) == (Phase.RETREATING, 2)
    assert (state.run.travel, state.motion.reversed) == (0.0, 0.4)


@pytest.mark.parametrize('kinds', [('LOST',), ('HALTED', 'LOST'), ('LOST', 'HALTED', 'TIMED_OUT')])
def test_a_command_that_was_withdrawn_meanwhile_counts_in_full(kinds: tuple[str, ...]) -> None:
    # The base obeyed it until then, and nobody says how long.
    state = in_phase(Phase.RETREATING, command=Command(Twist(-0.2, 0.0)))
    for kind in kinds:
        state = interrupted(state, Interruption[kind], 'no new tracks')
    assert then(state, sight(5)).motion.reversed == pytest.approx(0.1)


@pytest.mark.parametrize(('frame', 'seconds'), [(1300, 0.1), (0, 0.1), (-9000, 0.1)])
def test_stamps_that_leap_do_not_hide_what_is_driven_backward(frame: int, seconds: float) -> None:
    state = in_phase(Phase.RETREATING, command=Command(Twist(-0.2, 0.0)), period=0.1)
    assert then(state, sight(frame)).motion.reversed == pytest.approx(0.2 * seconds)


@pytest.mark.parametrize('phase', STEPS)
@pytest.mark.parametrize('sign', [-1.0, 1.0])
def test_no_way_is_longer_than_the_distance_allows(phase: Phase, sign: float) -> None:
    settings = replace(SETTINGS, initial_distance=4.0)
    state = then(in_phase(phase, travel=sign * 6.01), settings=settings)
    assert (state.phase, state.twist) == (Phase.FAILED, STANDSTILL)
    assert state.reason == f'drove 6 m in {phase.value} and is not there (initial_distance)'
    assert then(in_phase(phase, travel=sign * 5.99), settings=settings).phase is not Phase.FAILED


@pytest.mark.parametrize(
    ('left', 'travel', 'ends'), [(2.0, 6.01, False), (3.1, 6.01, True), (2.0, 12.01, True)]
)
def test_by_its_memory_it_may_have_begun_twice_as_far_away(left, travel, ends) -> None:
    settings = replace(SETTINGS, initial_distance=4.0)
    seen = replace(sight(), offset=(0.1, math.sqrt(left**2 - 0.01)))
    limit = asked(excursion_limit, in_phase(Phase.ZEROING_EPIPOLES, travel=travel), seen, settings)
    assert ('initial_distance' in limit) is ends


def off(ratio: float, phase: Phase = Phase.ZEROING_EPIPOLES, **changes: Any) -> ServoState:
    """Return a state that is ``ratio`` times as far off as where its leg began."""
    distance = 3.0
    x, y = (distance * (1.0 - 1.0 / ratio) * f(BEARINGS.psi) for f in (math.cos, math.sin))
    leg = Leg(x, y)
    return in_phase(phase, **{'leg': leg, 'extrinsics': ranged(distance), **changes})


@pytest.mark.parametrize('phase', STEPS)
def test_who_is_led_away_from_the_goal_fails_and_says_so(phase: Phase) -> None:
    state = then(off(1.4, phase))
    assert (state.phase, state.twist) == (Phase.FAILED, STANDSTILL)
    assert state.reason == (
        f'{phase.value} leads away from the goal: 1.4 times the distance (max_excursion)'
    )
    assert then(off(1.29, phase)).phase is not Phase.FAILED


@pytest.mark.parametrize(
    ('ratio', 'bound', 'ends'), [(1.29, 1.28, True), (2.0, 2.1, False), (9.0, 0.0, False)]
)
def test_the_bound_of_the_excursion_is_a_setting_and_0_is_none(ratio, bound, ends) -> None:
    bounded = replace(SETTINGS, max_excursion=bound)
    assert (then(off(ratio), settings=bounded).phase is Phase.FAILED) is ends
    with pytest.raises(ValueError, match=r'at least 1\.05 start distances, or 0 for none, got 0'):
        replace(SETTINGS, max_excursion=0.9)


@pytest.mark.parametrize(
    'changes',
    [{'leg': None}, {'extrinsics': None}, {'extrinsics': ranged(deviation=0.26)}, {}],
    ids=['no leg', 'no belief', 'not ranged', 'no bearings'],
)
def test_a_distance_that_is_not_known_is_no_excursion(changes: dict[str, Any]) -> None:
    assert asked(excursion_limit, off(2.0), sight(), SETTINGS) != ''
    known = estimated(off(2.0).changed(**changes))
    seen = sight() if changes else sight(bearings=None)
    assert asked(excursion_limit, known, seen, SETTINGS) == ''


def test_a_law_that_leads_away_by_itself_may_do_so() -> None:
    # Without retreat a law begins with concordant epipoles as well, and backs away.
    assert asked(excursion_limit, off(2.0), sight(), replace(SETTINGS, retreat=False)) == ''


@pytest.mark.parametrize('phase', DRIVING)
def test_steps_1_and_2_end_where_they_lead_astray(phase: Phase) -> None:
    state = off(2.0, phase, travel=-1e3)
    state = seeing(state, measurement=sight())
    bounded = phase in STEPS
    assert (classify(state, SETTINGS) is Event.EXCURSION) == bounded


def test_who_may_not_back_off_at_all_does_not_and_says_what_to_do() -> None:
    settings = replace(SETTINGS, max_retreat=0.0)
    state = backing_off(settings, frames=3)
    assert (state.phase, state.motion.reversed, state.command) == (Phase.FAILED, 0.0, HALT)
    assert state.reason.startswith('the robot would have to back off, and max_retreat is 0')
    begins = then(in_phase(Phase.WAITING), SIDEWAYS, settings)
    assert (begins.phase, begins.command) == (Phase.RETREATING, HALT)


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
