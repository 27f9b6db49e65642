"""
Trimming: pulses by which a turn in place ends on the heading itself, in spite of a dead band.

A base that follows no slow turn is turned by pulses, each of which is a hop of threshold times
frame. Equal hops end anywhere within half of one. Where a memory of views knows the heading much
finer than that, the last hops are stretched, so that a whole number of them leads onto it; who is
nearer than one hop first turns away by one.
"""

import math

from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.servo.anticipation import anticipated
from visual_servo_epipolar.core.servo.phases.bounds import is_trimmed, trial_of
from visual_servo_epipolar.core.servo.phases.table import Phase
from visual_servo_epipolar.core.servo.phases.timing import usual_step
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState

SEEN_S = 0.6  # after which a pulse has acted and was seen, of a base and images somewhat late


def trims(state: ServoState, settings: ServoSettings) -> bool:
    """Return whether the robot turns in place to a heading that it knows finer than its hops."""
    measurement = state.measurement
    if state.phase is not Phase.ORIENTING or measurement is None:
        return False
    return is_trimmed(measurement, settings, trial_of(state))


def trimmed(wanted: Twist, state: ServoState, settings: ServoSettings) -> tuple[Twist, Twist]:
    """
    Return the turn to command for the one ``wanted``, and the residual, both [rad/s].

    What is below the dead band adds up to a pulse, and one is seen before the next.
    """
    threshold, measurement = settings.dead_band_angular, anticipated(state, settings).measurement
    if measurement is None or abs(wanted.angular) >= threshold:
        return wanted, STANDSTILL
    frame_s = usual_step(state)
    added = max(abs(wanted.angular), threshold * frame_s / SEEN_S)
    residual = abs(state.dead_band_residual.angular) + added
    if residual < threshold:
        return STANDSTILL, Twist(0.0, residual)
    pulse = pulse_to(-measurement.heading_error, threshold, frame_s)
    return Twist(0.0, pulse), STANDSTILL


def pulse_to(turn: float, threshold: float, frame_s: float) -> float:
    """
    Return the rate [rad/s] for one frame, of those that lead to ``turn`` [rad].

    It is the ``threshold`` at least. A turn of less than a hop takes two: the first leads away.
    """
    hops = math.floor(abs(turn) / (threshold * frame_s))
    if not hops:
        return math.copysign(threshold, -turn)
    return turn / (hops * frame_s)
