"""
Pulse turn: pulses by which a turn in place ends on the heading itself, in spite of a dead band.

A base that follows no slow turn is turned by pulses, each of which is a hop of threshold times
frame. Equal hops end anywhere within half of one. Where a memory of views knows the heading much
finer than that, the last hops are stretched, so that a whole number of them leads onto it; who is
nearer than one hop first turns away by one.
"""

import math

from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phases.bounds import ends_by_pulses, facing_bound, trial_of
from visual_servo_epipolar.core.laws.prediction import predicted
from visual_servo_epipolar.core.laws.timing import usual_step
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState

SEEN_S = 0.6  # after which a pulse has acted and was seen, of a base that obeys in time


def turns_by_pulses(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether the robot turns in place to a heading that it knows finer than its hops."""
    measurement = state.measurement
    if not state.phase.turns_in_place or measurement is None:
        return False
    return ends_by_pulses(measurement, settings, trial_of(state))


def pulse_turn(wanted: Twist, state: ServoState, settings: ServoSettings) -> tuple[Twist, Twist]:
    """
    Return the twist to command for the one ``wanted``, and the residual.

    What is below the dead band adds up to a pulse, for as long as the one before takes to be seen.
    Who will be on the heading when all has acted stands. None turns away from it where that would
    lead features out of view.
    """
    threshold, measurement = settings.dead_band_angular, predicted(state, settings).measurement
    if measurement is None or wanted.linear or abs(wanted.angular) >= threshold:
        return wanted, STANDSTILL
    turn, frame_s = -measurement.heading_error, usual_step(state)
    if abs(turn) <= facing_bound(measurement, settings, trial_of(state)):
        return STANDSTILL, STANDSTILL
    waits_s = max(SEEN_S, settings.latency + SEEN_S / 2.0)
    residual = abs(state.motion.dead_band_residual.angular) + threshold * frame_s / waits_s
    if residual < threshold:
        return STANDSTILL, Twist(0.0, math.copysign(residual, turn))
    pulse = pulse_to(turn, threshold, frame_s, most=settings.max_angular)
    left, right = measurement.view_margins
    leads_out = pulse * turn < 0.0 and threshold * frame_s > (left if pulse > 0.0 else right)
    return STANDSTILL if leads_out else Twist(0.0, pulse), STANDSTILL


def pulse_to(turn: float, threshold: float, frame_s: float, *, most: float = math.inf) -> float:
    """Return the rate for one frame [rad/s] that leads to ``turn`` [rad], in whole hops."""
    hops = math.floor(abs(turn) / (threshold * frame_s))
    if not hops:
        return math.copysign(threshold, -turn)
    return math.copysign(min(abs(turn) / (hops * frame_s), most), turn)
