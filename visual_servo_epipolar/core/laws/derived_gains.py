"""
Derived gains: ``gains.derive`` for the circumstances of the moment step 1 or 2 begins.

Where no gain is legal the robot turns first (section IV-C 2, concordant epipoles too close to the
singularity); where no turn can help, the run fails with the reason. Gains that need longer than
a phase may last are a warning.
"""

import math

from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate, usual_step
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.laws.arrival import engage_bound
from visual_servo_epipolar.core.laws.circumstances import Circumstances
from visual_servo_epipolar.core.laws.conditions import discordant_bearing, displacement
from visual_servo_epipolar.core.laws.gains import (
    derive,
    Gains,
    longest_convergence,
    longest_matching,
)
from visual_servo_epipolar.core.laws.memory import Memory
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.laws.prediction import felt_latency


def gains_in_use(memory: Memory, settings: DriveSettings) -> Gains | None:
    """Return the gains derived for this step, unless those given are to hold by now."""
    return memory.law.gains if settings.derives else None


def with_gains_of_now(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Memory:
    """
    Return ``memory`` with gains for its step, 1 or 2, derived from the estimates of this moment.

    As it is where gains are given. Gains that are too slow for the phase are a warning. Raises
    ValueError if no gain is legal: see ``gains.derive``.
    """
    if not settings.derives:
        return memory
    alpha = 0.0 if goal.bearings is None else goal.bearings.alpha
    now = circumstances(goal, memory, settings, alpha=alpha)
    gains = derive(now)
    first = memory.phase is Phase.ZEROING_EPIPOLES
    duration = longest_convergence(now, gains) if first else longest_matching(now, gains)
    return memory.changed(gains=gains, warning=slow_gains(duration, settings))


def slow_gains(duration: float, settings: DriveSettings) -> str:
    """Return the warning that derived gains need longer than a phase may last; empty if not."""
    if duration <= settings.phase_timeout:
        return ''
    needed = enough(duration)
    both = ' and run_timeout' if needed > settings.run_timeout else ''
    return (
        f'derived gains need up to {duration:.0f} s; raise phase_timeout{both} to {needed:g}, or '
        'nearest_distance'
    )


def enough(duration: float) -> float:
    """Return a timeout that is enough for ``duration`` [s], a multiple of ten."""
    return 10.0 * math.ceil(duration / 10.0)


def circumstances(
    goal: GoalEstimate, memory: Memory, settings: DriveSettings, *, alpha: float
) -> Circumstances:
    """
    Return the circumstances of a step that begins with e_au at the bearing ``alpha`` [rad].

    d_hat - d does not change while d_hat follows (13), so that the lower bound of d at the start
    moves along. Step 2 begins aligned: its k_t depends on no bearing.
    """
    chi = 0.0 if goal.bearings is None else goal.bearings.chi
    # Whether e_du counts as zero when the step begins.
    unseen = memory.phase is Phase.MATCHING_FEATURES or goal.bearings is None
    landed = unseen or abs(chi) <= engage_bound(goal, settings)
    landing = max(settings.latch_engage, 1e-6)
    farthest = min(max(goal.motion.distance, 0.1), 100.0)
    nearest = farthest - (settings.initial_distance - settings.nearest_distance)
    return Circumstances(
        concordant=not landed and alpha * chi > 0.0,
        current=min(max(abs(alpha), 0.001), 1.0 if landed else 1.57),
        desired=max(2.0 * landing, 0.001) if landed else min(max(abs(chi), 0.001), 1.56),
        farthest=farthest,
        nearest=min(max(nearest, settings.min_distance, 0.05), farthest),
        max_linear=settings.max_linear,
        max_angular=settings.max_angular,
        deceleration=min(2.0 * settings.max_acceleration, 20.0),  # slowing down is twice as fast
        rate=min(max(1.0 / usual_step(goal.period), 0.5), 1000.0),
        latency=felt_latency(settings),
        landing=landing,
        depth=settings.scene_depth,
    )


def legal_target(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> float:
    """
    Return the abscissa of e_au, at unit focal length, for DISPLACING: one that has legal gains.

    Raises ValueError if neither the present e_au nor the discordant one has any.
    """
    if goal.bearings is None:
        return 0.0
    reason = 'the field of view leaves no room to turn e_au to where a gain is legal'
    present, discordant = goal.bearings.alpha, displacement(goal, settings)
    if settings.options.discordant_turn:
        tried = [discordant_bearing(goal, settings)]
    else:  # the present one first, if the law may keep it
        tried = [present] if abs(present) >= 2.0 * settings.singular_epipole else []
        tried += [] if discordant is None else [discordant]
    for alpha in tried:
        try:
            derive(_worst_circumstances(alpha, goal, memory, settings))
        except ValueError as error:
            reason = str(error)
        else:
            return math.tan(alpha)
    raise ValueError(reason)


def _worst_circumstances(
    alpha: float, goal: GoalEstimate, memory: Memory, settings: DriveSettings
) -> Circumstances:
    """Return the circumstances at the worst bearing that is within tolerance of ``alpha``."""
    tolerance = settings.displacement_tolerance
    concordant = circumstances(goal, memory, settings, alpha=alpha).concordant
    worst = max(abs(alpha) - tolerance, 0.0) if concordant else abs(alpha) + tolerance
    return circumstances(goal, memory, settings, alpha=math.copysign(worst, alpha))
