"""Dead bands: learnt where the base stood, by nobody who moves, and never past what is slow."""

from collections.abc import Iterable
from dataclasses import replace
from itertools import repeat
import math

import pytest
from servo_states import in_phase, MEMORY, reading, SETTINGS, sight, then

from visual_servo_epipolar.core.bases.differential_drive import followed_speed
from visual_servo_epipolar.core.estimate.base_model import (
    Curvature,
    FOLLOWED,
    largest_dead_band,
)
from visual_servo_epipolar.core.estimate.dead_band import (
    DeadBand,
    LEAST_ASKED,
    MARGIN,
    MOST_HOP,
    Threshold,
)
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.supervisor import update
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.perceive import Perception

DT = 0.1
NOTHING, UNKNOWN = Threshold(), DeadBand()


def judged(
    velocities: Iterable[float],
    moved: float = 0.0,
    *,
    dts: Iterable[float] = repeat(DT),
    begun: Threshold = NOTHING,
    deviation: float = 1e-3,
    most: float = 0.1,
    **known: float,
) -> Threshold:
    """Return the threshold of a base that makes of commands the part ``moved``."""
    threshold, position = begun, 1.0
    for velocity, dt in zip(velocities, dts, strict=False):
        position += moved * velocity * dt
        threshold = threshold.updated(position, deviation, velocity, dt, most=most, **known)
    return threshold


@pytest.mark.parametrize(
    ('velocities', 'known', 'least', 'most'),
    [
        pytest.param([0.01] * 70, {}, LEAST_ASKED / DT, LEAST_ASKED / DT, id='a base that stands'),
        pytest.param([-0.01] * 70, {}, LEAST_ASKED / DT, LEAST_ASKED / DT, id='to the other side'),
        pytest.param([0.03] * 70, {}, MARGIN * 0.03, MARGIN * 0.03, id='of a faster command'),
        pytest.param([0.03] * 18, {}, MARGIN * 0.03, MARGIN * 0.03, id='one stand is enough'),
        pytest.param([0.01] * 40, {'moved': 0.6}, 0.0, 0.0, id='worn wheels'),
        pytest.param([0.01] * 40, {'moved': 1.3}, 0.0, 0.0, id='larger wheels'),
        pytest.param([0.11] * 40, {}, 0.0, 0.0, id='held, at a speed that is not slow'),
        pytest.param([0.09] * 600, {}, 0.09, 0.1, id='never past what is slow'),
        pytest.param([0.05] * 7, {}, 0.0, 0.0, id='a base that follows late is waited for'),
        pytest.param([0.05] * 12, {'latency': 1.0}, 0.0, 0.0, id='and longer if known to be'),
        pytest.param([0.05] * 15, {'latency': 1.0}, 0.05, 0.1, id='but not for ever'),
        pytest.param([0.01] * 40, {'deviation': 0.01}, 0.0, 0.0, id='noise hides it'),
        pytest.param([0.01] * 40, {'deviation': math.nan}, 0.0, 0.0, id='nothing is measured'),
        pytest.param([0.05] * 2 + [0.0] * 20 + [0.05] * 6, {}, 0.0, 0.0, id='after a pause'),
        pytest.param(([0.01] * 5 + [-0.01] * 5) * 10, {}, 0.0, 0.0, id='to and fro'),
        pytest.param([0.03, 0.0, 0.0] * 34, {}, 0.07425, 0.1, id='pauses between pulses'),
        pytest.param([0.05] * 12, {'deviation': 1e-4}, 0.05, 0.1, id='a turn in place'),
        pytest.param(
            [0.03] * 12, {'dts': [DT] * 6 + [1.0] + [DT] * 5}, 0.0, 0.0, id='images that hang'
        ),
        pytest.param([0.03] * 3, {'dts': [0.6] * 3, 'moved': 1.0}, 0.0, 0.0, id='after a gap'),
    ],
)
def test_a_base_that_stands_below_a_command_needs_more(velocities, known, least, most) -> None:
    threshold = judged(velocities, **known)
    assert least - 1e-9 <= threshold.value <= most + 1e-9
    assert threshold.value or not threshold.stood


def test_a_pulse_is_not_judged_before_it_acts() -> None:
    threshold, position = Threshold(0.05), 0.0
    for frame in range(60):
        velocity = 0.0 if frame % 6 else 0.05
        if frame % 6 == 4:
            position += 0.2 * 0.05 * DT  # late, and most of it spent on speeding up
        threshold = threshold.updated(position, 3e-4, velocity, DT, most=0.1)
    assert threshold.value == 0.05


def test_a_push_against_a_slow_command_is_no_standstill() -> None:
    threshold, position = Threshold(), 0.0
    for frame in range(12):
        position += 0.03 * DT - 0.2 * (frame == 7)
        threshold = threshold.updated(position, 1e-3, 0.03, DT, most=0.1)
    assert threshold.value == threshold.stood == 0.0


def test_the_last_command_before_it_moved_is_not_the_least_that_moves_it() -> None:
    """A base that speeds up out of its dead band stood below less than what moved it."""
    speeds = [0.02 if k != 13 else 0.09 for k in range(90)]
    assert 0.0 < judged(speeds, most=0.2).value < MARGIN * 0.06


def test_stamps_that_leap_teach_nothing() -> None:
    threshold = judged([0.02] * 30, deviation=0.05)
    leapt = judged([0.02], dts=[0.0], begun=threshold)  # surer where no time has passed
    assert leapt == Threshold()


STANDING = sight(heading_error=0.01, heading_deviation=1e-4)


def learnt(
    twists: Iterable[tuple[float, float]],
    seen: Measurement = STANDING,
    said: MapLocalization | None = None,
    *,
    band: DeadBand = UNKNOWN,
    dt: float = DT,
    settings: ServoSettings = SETTINGS,
) -> DeadBand:
    """Return what a base tells that stands, whatever is commanded [m/s, rad/s]."""
    for twist in twists:
        band = band.updated(seen, said, Twist(*twist), dt, settings)
    return band


def turned(velocity: float, moved: float, *, linear: float = 0.0) -> DeadBand:
    """Return what turns of a robot, near the border of +-pi, tell of its base."""
    band, heading = DeadBand(), math.pi - 0.005
    for _ in range(40):
        heading = math.remainder(heading + moved * velocity * DT, 2.0 * math.pi)
        seen = sight(heading_error=heading, heading_deviation=1e-4)
        band = band.updated(seen, None, Twist(linear, velocity), DT, SETTINGS)
    return band


def test_turns_are_counted_over_the_border() -> None:
    assert turned(0.02, 1.0).angular.value == 0.0
    band = DeadBand()
    for k in range(60):  # a robot that stands, seen on both sides of the border
        heading = math.copysign(math.pi - 1e-4, (-1.0) ** k)
        seen = sight(heading_error=heading, heading_deviation=1e-4)
        band = band.updated(seen, None, Twist(0.0, 0.02), DT, SETTINGS)
    assert band.angular.value > 0.02


def test_unequal_wheels_that_undo_a_turn_are_not_taken_for_standing() -> None:
    assert turned(0.02, 0.0, linear=0.1).angular.value == 0.0


def at_speed(
    *turns: float,
    curvature: float = 0.0,
    dead_band: float = 0.08,
    drives: bool = True,
    settings: ServoSettings = SETTINGS,
) -> DeadBand:
    """Return what ``turns`` [rad/s] of 5 s each, at 0.2 m/s, by pulses at last, tell of a base."""
    band, heading, owed = DeadBand(), 0.0, 0.0
    for wanted in turns:
        for _ in range(50):
            velocity, owed = followed_speed(wanted, owed, band.angular.value, 'pulse')
            follows = abs(velocity) >= dead_band
            heading += (follows * velocity + 0.2 * curvature) * DT
            seen, twist = replace(STANDING, heading_error=heading), Twist(0.2, velocity)
            band = band.updated(seen, None, twist, DT, settings, view_moves=drives)
    return band


def test_a_base_that_goes_nowhere_at_speed_is_deaf_and_has_no_dead_band() -> None:
    assert at_speed(0.04, -0.04, 0.02, drives=False).angular.value == 0.0


def test_a_base_that_has_one_dead_band_has_both_as_long_as_no_other_is_configured() -> None:
    """Turns that change nothing tell it at full speed, also without a map."""
    assert at_speed(0.04, -0.03).angular.value >= 0.08
    both = at_speed(0.04)
    assert (both.angular.value >= 0.08, both.linear.value) == (True, FOLLOWED)
    assert at_speed(0.04, settings=replace(SETTINGS, dead_band_linear=0.01)).linear.value == 0.0
    assert at_speed(-0.02, curvature=0.1, dead_band=0.0).linear.value == 0.0


@pytest.mark.parametrize('curvature', [0.1, -0.2])
def test_wheels_of_one_curvature_undo_no_turns_of_others(curvature: float) -> None:
    """Pulses tell: such wheels turn the base between them, and no pulses are left."""
    undone = -0.2 * curvature
    wheels = {'curvature': curvature, 'dead_band': 0.0}
    assert at_speed(undone, **wheels).angular.value == 0.0
    assert at_speed(undone, 1.4 * undone, 0.8 * undone, **wheels).angular.value == 0.0


def test_a_dead_band_is_no_curvature() -> None:
    state = in_phase(Phase.ORIENTING, curvature=Curvature(0.2))
    state = state.changed(command=replace(state.command, twist=Twist(0.0, -0.02)))
    for frame in range(2, 60):
        state = update(state, Perception(turning(frame), MEMORY), DT, SETTINGS)
    assert state.identified.curvature.value == 0.0


@pytest.mark.parametrize('parallax', [0.5, 40.0])
def test_a_rotation_alone_tells_turns_but_for_parallax(parallax: float) -> None:
    seen = sight(bearings=None, heading_error=0.0)
    band = learnt([(0.0, 0.02)] * 40, replace(seen, parallax=parallax * seen.noise))
    assert (band.angular.value > 0.02) is (parallax < 1.0)


def test_pulses_ahead_and_back_do_not_keep_from_learning_of_turns() -> None:
    speeds = [0.0 if frame % 6 else math.copysign(0.05, frame % 12 - 3) for frame in range(40)]
    begun = DeadBand(linear=Threshold(0.05))
    band = learnt([(speed, 0.007) for speed in speeds], said=reading(), band=begun)
    assert band.angular.value > 0.02


def test_a_base_that_does_not_drive_slowly_is_not_taken_to_turn_slowly_either() -> None:
    for settings in (SETTINGS, replace(SETTINGS, dead_band_angular=0.01)):
        band = learnt([(0.02, 0.0)] * 40, sight(), reading(), settings=settings)
        assert 0.02 < band.linear.value <= largest_dead_band(settings.max_linear)
        assert bool(band.angular.value) is not bool(settings.dead_band_angular)
        assert band.angular.value <= largest_dead_band(settings.max_angular)


@pytest.mark.parametrize(
    ('gone', 'error', 'raised'),
    [
        (0.0, 0.5e-3, True),
        (0.3e-3, 0.5e-3, True),
        (0.0, 1.2e-3, False),
        (0.7e-3, 0.0, False),
        (-0.2, 0.0, False),
    ],
)
def test_pulses_that_lead_nowhere_between_two_stands_raise_the_dead_band(
    gone: float, error: float, raised: bool
) -> None:
    band = DeadBand(linear=Threshold(0.02), angular=Threshold(0.03))
    after, turned = (
        judge(4e-3, gone, error, DT, SETTINGS) for judge in (band.after_move, band.after_turn)
    )
    assert (after.linear.value == pytest.approx(MARGIN * 0.02)) is raised
    assert (turned.angular.value == pytest.approx(MARGIN * 0.03)) is raised
    assert (after.angular, turned.linear) == (band.angular, band.linear)
    assert raised or after == turned == band
    wide = DeadBand(linear=Threshold(0.09)).after_move(4e-3, gone, error, DT, SETTINGS)
    assert 0.09 <= wide.linear.value <= 0.1


@pytest.mark.parametrize(
    ('velocities', 'raised'),
    [((0.05,), True), ((0.04, 0.0), True), ((0.05, 0.05, *[0.0] * 8), False)],
)
def test_a_base_that_goes_on_standing_needs_more_than_what_its_turns_made_of_it(
    velocities: tuple[float, ...], raised: bool
) -> None:
    """It never stands by its commands, so that no move between two stands tells."""
    begun = DeadBand(linear=Threshold(0.033), angular=Threshold(0.033))
    twists = [(velocity, 0.0) for velocity in velocities * 30]
    band = learnt(twists[:30], sight(), reading(), band=begun)
    assert (band.linear.value > 0.06) is raised


def test_two_views_tell_turns_but_no_way() -> None:
    seen = sight(covariance=1e-6 * reading().bearings_covariance)
    band = learnt([(0.02, 0.0)] * 40, seen)
    assert band.linear.value == 0.0
    assert learnt([(0.0, 0.02)] * 40, seen, band=band).angular.value > 0.02


def turning(frame: int) -> Measurement:
    """Return a sight of a robot that has 0.02 rad to turn, and does not."""
    return sight(frame, bearings=None, parallax=0.0, heading_error=0.02, heading_deviation=1e-4)


def test_a_turn_alone_is_no_way_back() -> None:
    """A goal aside comes nearer along the robot's axis as it turns; it creeps ahead as well."""
    band, right, ahead, heading = DeadBand(), 0.5, -0.3, 0.0
    for _ in range(60):
        right -= 0.02 * DT * math.sin(heading)
        ahead += 0.02 * DT * math.cos(heading)
        heading += 0.05 * DT
        seen = reading(lateral=right, longitudinal=ahead, heading_error=heading)
        band = band.updated(sight(), seen, Twist(0.02, 0.05), DT, SETTINGS)
    assert band.linear.value == 0.0


def test_limits_that_are_lowered_hold_for_what_was_learnt() -> None:
    band = DeadBand(linear=Threshold(0.08), angular=Threshold(0.1))
    settings = band.beside(replace(SETTINGS, max_linear=0.05, max_angular=0.09))
    assert (settings.dead_band_linear, settings.dead_band_angular) == (0.05, 0.065)
    settings = band.beside(replace(SETTINGS, max_linear=0.35, max_angular=0.45))
    assert settings.dead_band_linear == pytest.approx(0.07)
    assert settings.dead_band_angular == pytest.approx(0.09)


@pytest.mark.parametrize('change', [{'learnt_dead_band': False}, {'dead_band_mode': 'zero'}])
def test_who_may_not_learn_forgets(change) -> None:
    """Dropped instead of sent as pulses, what was learnt would let the robot stand for good."""
    settings = replace(SETTINGS, **change)
    band = DeadBand(angular=Threshold(0.05))
    assert band.beside(settings) is settings
    state = in_phase(Phase.ORIENTING, dead_band=band)
    assert then(state, turning(2), settings).identified.dead_band == DeadBand()


def test_few_images_a_second_make_long_pulses_so_they_are_slow() -> None:
    band = learnt([(0.0, 0.015)] * 20, dt=0.45)
    assert 0.015 < band.angular.value <= 2.0 * MOST_HOP[1] / 0.45


def test_commands_below_what_was_learnt_come_as_pulses() -> None:
    band = DeadBand(angular=Threshold(0.05))
    settings = band.beside(SETTINGS)
    assert settings.dead_band_angular == 0.05
    assert settings.dead_band_linear == SETTINGS.dead_band_linear
    assert band.beside(settings) is settings
    wider = replace(SETTINGS, dead_band_angular=0.08)
    assert band.beside(wider) is wider  # who was told more knows better
    state = in_phase(Phase.ORIENTING, dead_band=band)
    sent = set()
    for frame in range(2, 14):  # before it is seen that this one does not turn at all
        state = then(state, turning(frame))
        sent.add(round(abs(state.twist.angular), 6))
    assert {0.0, 0.05} <= sent and not any(0.0 < each < 0.05 for each in sent)


@pytest.mark.parametrize(('follows', 'learnt'), [(0.0, True), (1.0, False)])
def test_without_a_memory_features_tell_whether_the_base_drives(follows, learnt) -> None:
    band, error, slope = DeadBand(), -0.1, 0.14
    for _ in range(60):
        error += follows * 0.02 * DT
        seen = sight(difference=slope * error, difference_deviation=1e-4)
        band = band.updated(seen, None, Twist(0.02, 0.0), DT, SETTINGS, slope)
    assert (band.linear.value > 0.02) is learnt
    band = band.updated(sight(), None, Twist(0.02, 0.0), DT, SETTINGS)  # the slope is lost
    assert math.isfinite(band.along)
