"""Arrival: whether this is the goal, as far as two views or a memory of views can tell."""

import math

from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.servo.phases.bounds import (
    facing_bound,
    matched_bound,
    NOISE_DEVIATIONS,
    trial_of,
)
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState

STANDSTILL_PARALLAX = 1.25  # without a baseline, in deviations of the noise: see ``fit_rotation``
ARRIVAL_OFFSET = 2e-3  # of who has arrived, by a memory of views [m]
ASIDE = 2.0  # deviations of a mean over looks, all of which share the photograph's noise
CLEARLY_ASIDE = 4.0  # of a mean over a few
CONTRADICTED = 4.0  # bounds of a parallax, beyond which no memory says that it is the goal


def has_parallax(state: ServoState, measurement: Measurement, settings: ServoSettings) -> bool:
    """
    Return whether the parallax exceeds what noise explains: the robot is not at the goal.

    A memory of views knows it far better, but through a lens that is told wrong its geometry may
    be one that is not there: it never overrules an image that looks another.
    """
    parallax = measurement.parallax if state.settled < 2 else state.settled_parallax
    # The root of a mean square over N features varies by 0.5 / sqrt(N) and more.
    variation = 1.0 + 1.5 / math.sqrt(max(measurement.features, 1))
    if is_in_doubt(measurement, settings) and state.attempts == 1:
        variation = 1.0  # it has looked for long, and a small way back and forth will tell
        if abs(state.settled_aside) > ASIDE:
            return True
    noise = STANDSTILL_PARALLAX * measurement.noise * variation
    usual = math.hypot(settings.arrival_parallax, noise)
    if measurement.offset is None:
        return not parallax <= usual
    # A worn base may never come as near as the memory can tell: each attempt asks for less.
    least = ARRIVAL_OFFSET * state.attempts
    bound = max(least, NOISE_DEVIATIONS * measurement.offset_deviation)
    return not (parallax <= CONTRADICTED * usual and math.hypot(*measurement.offset) <= bound)


def is_in_doubt(measurement: Measurement, settings: ServoSettings) -> bool:
    """Return whether a memory of views would know whether this is the goal, but there is none."""
    return settings.remembers and measurement.offset is None


def sees_nothing_of_it(measurement: Measurement) -> bool:
    """Return whether others than the photograph's features carry on: they cannot tell the end."""
    return measurement.carried and math.isnan(measurement.feature_error)


def stands_aside(state: ServoState, measurement: Measurement, settings: ServoSettings) -> bool:
    """Return whether a few looks are enough for who is in doubt: it stands clearly aside."""
    first = is_in_doubt(measurement, settings) and state.attempts == 1
    return first and abs(state.settled_aside) > CLEARLY_ASIDE


def is_at_goal(state: ServoState, measurement: Measurement, settings: ServoSettings) -> bool:
    """
    Return whether heading, parallax and D are those of the photograph, within their noise.

    Who is in doubt has to look for longer, in step 2.
    """
    if is_in_doubt(measurement, settings) or sees_nothing_of_it(measurement):
        return False
    bound = facing_bound(measurement, settings, trial_of(state))
    faces_goal = abs(measurement.heading_error) <= bound
    bound = matched_bound(measurement, settings, trial_of(state, spent=True))
    matched = abs(measurement.difference) <= bound
    return faces_goal and matched and not has_parallax(state, measurement, settings)
