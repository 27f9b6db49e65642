"""
Braking: turns and drives that end at a constant deceleration, not exponentially.

A gain g drives what is left to zero at the rate g for ever: a turn of 0.2 rad takes 6 s to 0.0015
at 0.8 1/s. With limited accelerations a base brakes by these instead, and only the rest decays.
"""

import math

from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate, usual_step
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.laws.equations import LINE_DAMPING
from visual_servo_epipolar.core.laws.gains import CRITICAL_GAIN_DELAY
from visual_servo_epipolar.core.laws.prediction import is_late
from visual_servo_epipolar.core.mapping.window import X
from visual_servo_epipolar.core.stamps import NANOSECONDS

BRAKING = 1.6  # of an acceleration, at which it closes in: the ramps slow down by 2
TURN_BRAKING = 1.3  # the same of turns in place: what is left of it is for the feedback
LANDING = 1.2  # frames in which a turn ends that is a frame from its end: it is known so well
TAIL_S = 0.25  # time constant of the last centimetre, and of the turn at its end
STEERING_S = 0.35  # look-ahead in time: what is steered within less, a late loop swings by
LEAST_LOOK_AHEAD = 0.02  # [m]
NEAR = 0.35  # way left on which the rest aside is steered to zero [m]
WELL_KNOWN = 6e-4  # deviation aside up to which it closes in at full speed [m]
LEAST_RESIDUAL = 1e-4  # that steering may leave aside [m]
CREEP = 0.03  # least speed for the sake of steering [m/s]
FACING_FROM, FACING_AT = 0.012, 0.004  # way left at which the heading alone counts, at last [m]
SHARPER = 4.0  # times a gain, at which a braked motion ends: it is not late by its ramps


def rate_within(margin: float, *, deceleration: float, delay: float) -> float:
    """
    Return the largest rate towards a bound ``margin`` away that stops there, and back beyond it.

    v delay + v^2 / (2 b) = margin: braking at the constant ``deceleration`` b, which begins a
    ``delay`` [s] late. Near the bound that is margin / delay. Also of speeds and ways [m/s, m].
    """
    late = deceleration * delay
    speed = math.sqrt(late * late + 2.0 * deceleration * abs(margin)) - late
    return math.copysign(speed, margin)


def converging_speed(
    aside: float, left: float, goal: GoalEstimate, braking: float, power: float
) -> float:
    """
    Return the speed at which what is ``aside`` [m] decays on the way that is ``left`` [m/s].

    It does by exp(-0.9 s / L) over a way s, and no look-ahead L is driven within less than
    TAIL_S; from farther away than NEAR it falls as a ``power`` of the distance until then.
    """
    aside *= min(NEAR / max(left, NEAR), 1.0) ** power
    # Steering may leave half of what the place is unknown by.
    known = min(place_deviation(goal) or WELL_KNOWN, WELL_KNOWN)
    residual = max(0.5 * known, LEAST_RESIDUAL)
    decays = math.log(max(aside / residual, 1.0))
    if decays == 0.0:
        return math.inf
    near = min(left, NEAR)
    speed = max(LINE_DAMPING * near / (decays * TAIL_S), min(CREEP, near / TAIL_S))
    return math.sqrt(speed * speed + 2.0 * braking * (left - near))


def looking_speed(left: float, goal: GoalEstimate, settings: DriveSettings) -> float:
    """Return the speed [m/s] at which views enough show what is aside on the way ``left`` [m]."""
    # What is unknown falls as 1 / sqrt of the views that see it from near.
    known = min(WELL_KNOWN / max(place_deviation(goal), WELL_KNOWN), 1.0) ** 2
    slow = max(known * settings.max_linear, CREEP)
    braking = BRAKING * settings.max_acceleration
    return math.sqrt(slow * slow + 2.0 * braking * max(left - NEAR, 0.0))


def place_deviation(goal: GoalEstimate) -> float:
    """Return what the averaged place is unknown by, aside [m]; 0 without an average."""
    return 0.0 if goal.place is None else math.sqrt(goal.place.covariance[X, X])


def heading_share(left: float) -> float:
    """Return the weight of the heading alone, by the way that is ``left`` [m]."""
    share = (FACING_FROM - abs(left)) / (FACING_FROM - FACING_AT)
    return min(max(share, 0.0), 1.0)


def braked_turn(angle: float, goal: GoalEstimate, settings: DriveSettings) -> float:
    """
    Return the rate [rad/s] of a turn in place of which an ``angle`` [rad] is left, as seen.

    It is a trapezoid once turns have shown how late the base obeys. Without speed ramps the rate
    is that of ``turn_gain``.
    """
    landing = _landing_turn(angle, goal, settings)
    if abs(landing) > settings.dead_band_angular:
        return landing
    return settled_turn(angle, goal, settings)


def settled_turn(angle: float, goal: GoalEstimate, settings: DriveSettings) -> float:
    """Return the same for a turn that ends as an exponential, however late the base obeys."""
    if not settings.options.speed_ramps:
        return settings.turn_gain * angle
    return braked(
        angle - goal.twist.angular * unfelt_latency(settings),
        goal,
        gain=settings.turn_gain,
        deceleration=BRAKING * settings.max_angular_acceleration,
        dead_band=settings.dead_band_angular,
    )


def _landing_turn(angle: float, goal: GoalEstimate, settings: DriveSettings) -> float:
    """
    Return the rate [rad/s] of a turn of a trapezoid, whose last frame ends where it is to.

    What was commanded and has not acted is turned already; 0 where that is unknown.
    """
    late = math.nan if is_late(settings) else goal.base.response
    if math.isnan(late) or not (settings.turn_gain and settings.options.speed_ramps):
        return 0.0
    now_ns = goal.stamp_ns
    acting = goal.motion.sent.acting(now_ns, now_ns + round(late * NANOSECONDS), late)
    left = angle - math.fsum(span * twist.angular for span, twist in acting)
    frame_s = LANDING * usual_step(goal.period)
    rate = rate_within(
        left, deceleration=TURN_BRAKING * settings.max_angular_acceleration, delay=0.5 * frame_s
    )
    return math.copysign(min(abs(rate), abs(left) / frame_s), left)


def braked(
    left: float, goal: GoalEstimate, *, gain: float, deceleration: float, dead_band: float
) -> float:
    """
    Return the speed of a motion of which ``left`` is left, that ends by ``gain`` [1/s] unbraked.

    It ends more sharply than that, but no sharper than images come. What the base follows by
    pulses alone it ends by the gain as it is: each of them has to be seen. [rad, m, s]
    """
    if gain == 0.0:
        return 0.0
    sharp = min(SHARPER * gain, max(gain, CRITICAL_GAIN_DELAY / usual_step(goal.period)))
    speed = rate_within(left, deceleration=deceleration, delay=1.0 / sharp)
    if abs(speed) > dead_band:
        return speed
    by_pulses = rate_within(left, deceleration=deceleration, delay=1.0 / gain)
    return by_pulses if dead_band else speed


def unfelt_latency(settings: DriveSettings) -> float:
    """Return the delay [s] from what is seen to the next command, where it is not predicted."""
    return 0.0 if is_late(settings) else settings.latency
