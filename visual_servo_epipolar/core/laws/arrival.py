"""
Arrival: whether this is the goal, as far as two views or a memory of views can tell.

Bounds below which a measurement counts as zero are no finer than its noise, nor than the base
moves; where a memory of views knows the offset they are finer than two views could tell. A base
may be unable to come as near, and its dead band need not be configured: after a while within the
usual tolerance that is enough.

The tolerances of the owner are held against what is measured and what that may be wrong by. A
memory of views knows the offset in metres; two views know D alone, which the slope that it has
shown while driving turns into metres along the axis: what is aside only parallax tells.
"""

import math

from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate, usual_step
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.laws.memory import Memory

# Deviations that noise hardly reaches, and those that it never does; the first also of means over
# looks, all of which share the noise of the photograph.
NOISE_DEVIATIONS, SURE_DEVIATIONS = 2.0, 4.0
NEGLIGIBLE = 0.3  # deviations of what a memory says: more would be a bias of arrivals from behind
PULSE_MISS = 0.15  # of a hop, by which stretched pulses miss: a base slips
FACING = 6e-4  # heading error that two views leave; what a tolerance is less by, too [rad]
PATIENCE_S = 0.8  # within the usual bounds, after which they are enough
WEARY_S = 2.0  # near its aim, after which bounds grow with time: no robot stands for ever
STANDSTILL_PARALLAX = 1.25  # without a baseline, in deviations of the noise: see ``fit_rotation``
ARRIVAL_OFFSET = 2e-3  # of a robot that has arrived, by its memory of views [m]


def engage_bound(goal: GoalEstimate, settings: DriveSettings) -> float:
    """Return the largest bearing of e_du [rad] that counts as zero, its noise at least."""
    return max(settings.latch_engage, deviation(goal))


def release_bound(goal: GoalEstimate, settings: DriveSettings) -> float:
    """Return the bearing of e_du [rad] beyond which it has left zero, and not by noise alone."""
    return max(settings.latch_release, SURE_DEVIATIONS * deviation(goal))


def hysteresis(memory: Memory, settings: DriveSettings) -> float:
    """
    Return the factor by which step 1 is held on to: one for both steps.

    It doubles the first two times that step 1 is given up in an attempt, for a retreat or a new
    beginning: what spoke against it may be noise, or a wrongly configured geometry.
    """
    if not settings.options.retreat:
        return 1.0
    return 2.0 ** min(memory.run.restarts, 2)


def align_bound(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> float:
    """Return the largest bearing of e_au [rad] that counts as zero, its noise at least."""
    least = half_hop(settings.dead_band_angular, goal, memory, settings)
    # Hops are no finer than the steps of the base's speeds.
    return max(settings.align_tolerance, deviation(goal), (1.0 + 2.0 * PULSE_MISS) * least)


def facing_bound(
    goal: GoalEstimate, memory: Memory, settings: DriveSettings, *, spent: bool = False
) -> float:
    """
    Return the largest heading error [rad] that counts as zero, half of the least turn.

    It is the usual one, no finer, once the patience of the robot is ``spent``.
    """
    tolerance, noise, patient = settings.arrival_heading, 0.0, _is_patient(memory, spent)
    fine = min(tolerance, FACING)
    if goal.offset is not None:
        noise = goal.heading_deviation
        if patient:
            fine = min(NEGLIGIBLE * noise, fine)
    bound = max(fine, tolerance - FACING - NOISE_DEVIATIONS * noise)
    least = half_hop(settings.dead_band_angular, goal, memory, settings)
    if ends_by_pulses(goal, settings) and patient:
        # Of two pulses, one away and one back, neither lasts for exactly a frame.
        miss = max(PULSE_MISS * usual_step(goal.period), 2.0 * goal.jitter)
        least = min(least, miss * settings.dead_band_angular)
    return max(bound, least)


def ends_by_pulses(goal: GoalEstimate, settings: DriveSettings) -> bool:
    """Return whether turns end in place, by pulses: see ``servo.settling``."""
    known, pulses = goal.offset is not None, settings.dead_band_mode == 'pulse'
    return known and pulses and max(settings.dead_band_linear, settings.dead_band_angular) > 0.0


def matched_bound(
    goal: GoalEstimate, memory: Memory, settings: DriveSettings, *, spent: bool = False
) -> float:
    """Return the largest |D|, at unit focal length, that counts as zero, its noise at least."""
    least, noise = settings.arrival_difference, goal.difference_deviation
    usual = _growth(memory) * max(least, NOISE_DEVIATIONS * noise)
    hop = half_hop(settings.dead_band_linear, goal, memory, settings)
    if goal.offset is None:
        # While its slope is unknown (nan), D tells no hop; none is beyond the owner's tolerance.
        slope = max(0.0, goal.motion.slope.least(noise))
        return max(usual, slope * min(hop, settings.arrival_position or math.inf))
    hop *= goal.difference_slope
    fine = (1.0 if hop else NEGLIGIBLE) * noise
    return max(fine if _is_patient(memory, spent) else usual, hop)


def is_matched(
    goal: GoalEstimate, memory: Memory, settings: DriveSettings, *, spent: bool = False
) -> bool:
    """Return whether D counts as zero; within the usual bounds if patience is ``spent``."""
    return abs(goal.difference) <= matched_bound(goal, memory, settings, spent=spent)


def _is_patient(memory: Memory, spent: bool) -> bool:
    """Return whether the robot still tries for what is finer than usual."""
    return not spent and memory.settling.time_in_tolerance <= PATIENCE_S


def half_hop(
    threshold: float, goal: GoalEstimate, memory: Memory, settings: DriveSettings
) -> float:
    """Return half of the least motion of a base with this dead band, all of it if raised to it."""
    frames = 2.0 if settings.dead_band_mode == 'raise' else 0.5
    return frames * _growth(memory) * usual_step(goal.period) * threshold


def _growth(memory: Memory) -> float:
    """
    Return by how much bounds grow while the robot is near its goal, up to twice.

    What keeps it from ending is noise of which no deviation tells, or hops longer than commanded.
    """
    tried = max(memory.settling.time_in_tolerance, memory.settling.time_at_goal)
    return min(max(1.0, tried / WEARY_S), SURE_DEVIATIONS / NOISE_DEVIATIONS)


def deviation(goal: GoalEstimate) -> float:
    """Return the deviation of the bearings [rad]; 0 where it is unknown."""
    return 0.0 if math.isnan(goal.deviation) else goal.deviation


def has_parallax(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> bool:
    """
    Return whether the parallax exceeds what noise explains: the robot is not at the goal.

    A memory of views gives it far better, but through a wrongly configured lens its geometry may
    be one that is not there: it never overrules an image that looks another.
    """
    if _looks_elsewhere(goal, memory, settings):
        return True
    if goal.offset is None:
        return False
    x, y = goal.offset
    matched = is_matched(goal, memory, settings, spent=True)
    if matched and settings.arrival_position == 0.0:  # a tolerance of the owner's is a promise
        y = 0.0  # no attempt comes nearer along the axis
    return not math.hypot(x, y) <= _offset_bound(goal, memory, settings)


def _looks_elsewhere(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> bool:
    """Return whether the image shows more parallax than noise and the way that is left explain."""
    parallax = goal.parallax if memory.settling.settled < 2 else memory.settling.settled_parallax
    # The root of a mean square over N features varies by 0.5 / sqrt(N) and more.
    variation = 1.0 + 1.5 / math.sqrt(max(goal.features, 1))
    if is_in_doubt(goal, settings) and memory.run.attempts == 1:
        variation = 1.0  # it has looked for long, and a small way back and forth will tell
        if abs(memory.settling.settled_aside) > NOISE_DEVIATIONS:
            return True
    noise = STANDSTILL_PARALLAX * goal.noise * variation
    usual = math.hypot(settings.arrival_parallax, noise)
    if settings.arrival_position > 0.0:
        left, slope = goal.offset, goal.difference_slope
        of_the_rest = abs(goal.difference) if left is None else slope * math.hypot(*left)
        usual = math.hypot(usual, of_the_rest)
    # Beyond that no memory says that it is the goal.
    return not parallax <= (usual if goal.offset is None else SURE_DEVIATIONS * usual)


def _offset_bound(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> float:
    """Return the largest offset of a robot that has arrived, as its memory measures it [m]."""
    noise = NOISE_DEVIATIONS * goal.offset_deviation
    tolerance = settings.arrival_position
    if tolerance > 0.0:  # a promise: no attempt makes it larger, and no noise
        return max(tolerance - noise, min(noise, tolerance))
    # A worn base may never come as near as the memory can tell: each attempt asks for less.
    # Where the memory can tell that much, the first one does not stop within its noise.
    if memory.run.attempts == 1 and goal.offset_deviation <= ARRIVAL_OFFSET:
        noise = goal.offset_deviation
    return max(ARRIVAL_OFFSET * memory.run.attempts, noise)


def stands_beside(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> bool:
    """Return whether the robot stands at the goal but aside of it, where no last move leads."""
    if goal.offset is None or memory.settling.rested < settings.arrival_frames:
        return False
    x, y = goal.offset
    return abs(y) <= abs(x) and abs(x) > _offset_bound(goal, memory, settings)


def is_near_enough(
    goal: GoalEstimate,
    memory: Memory,
    settings: DriveSettings,
    *,
    deviations: float = NOISE_DEVIATIONS,
) -> bool:
    """
    Return whether the place is within the owner's tolerance, also once the robot has stopped.

    So are ``deviations`` of what is measured. Without a final turn the heading counts as well.
    """
    if settings.arrival_position == 0.0 or _looks_elsewhere(goal, memory, settings):
        return False
    if not (settings.options.final_turn or faces_goal(goal, memory, settings)):
        return False
    ahead = stopping(goal.twist.linear, settings.max_acceleration, settings)
    if goal.offset is not None:
        x, y = goal.offset
        reach = settings.arrival_position - deviations * goal.offset_deviation
        return max(math.hypot(x, y), math.hypot(x, y + ahead)) <= reach
    difference, noise = goal.difference, goal.difference_deviation
    slope = goal.motion.slope.least(noise)
    reach = slope * settings.arrival_position - deviations * noise
    return max(abs(difference), abs(difference + slope * ahead)) <= reach


def faces_goal(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> bool:
    """Return whether the heading is the goal's, where asked also once the robot has stopped."""
    bound = facing_bound(goal, memory, settings)
    heading, turn = goal.heading_error, 0.0
    if settings.arrival_heading > FACING:
        turn = stopping(goal.twist.angular, settings.max_angular_acceleration, settings)
    return max(abs(heading), abs(heading + turn)) <= bound


def stopping(speed: float, deceleration: float, settings: DriveSettings) -> float:
    """Return what a robot of this speed moves on by until it stands [m] or [rad]."""
    return speed * (settings.latency + 0.5 * abs(speed) / deceleration)


def is_in_doubt(goal: GoalEstimate, settings: DriveSettings) -> bool:
    """Return whether a memory of views would know whether this is the goal, but there is none."""
    return settings.remembers and goal.offset is None


def is_at_goal(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> bool:
    """
    Return whether heading, parallax and D are those of the photograph, within their noise.

    In doubt the robot looks for longer, in step 2.
    """
    if is_in_doubt(goal, settings):
        return False
    if not faces_goal(goal, memory, settings):
        return False
    if is_matched(goal, memory, settings, spent=True):
        return not has_parallax(goal, memory, settings)
    # A robot that has arrived is not sent away by noise.
    return is_near_enough(goal, memory, settings, deviations=1.0)
