"""
Law ``smooth``: one motion to the goal, its phase APPROACHING, and where that cannot begin or end.

Its velocity is that of the equations of ``steering``, from what is measured. A robot beside the
goal backs off first, on an arc. With two views alone the run ends as in the paper's second
step: a memory of views is what carries one motion through to its end.
"""

from dataclasses import replace
from functools import partial
import math
from typing import NamedTuple

from visual_servo_epipolar.core.bases.base import turns_in_place
from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate, usual_step
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist, wrap_angle
from visual_servo_epipolar.core.laws import arrival, conditions, steering
from visual_servo_epipolar.core.laws.braking import (
    BRAKING,
    converging_speed,
    heading_share,
    LEAST_LOOK_AHEAD,
    looking_speed,
    NEAR,
    place_deviation,
    rate_within,
    STEERING_S,
    TAIL_S,
    unfelt_latency,
)
from visual_servo_epipolar.core.laws.machine import PhaseRow, StateMachine
from visual_servo_epipolar.core.laws.memory import Memory
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.standing import (
    ARRIVED,
    FAILED,
    has_run_up,
    HOLDING,
    ORIENTING,
    RETREATING,
    WAITING,
)
from visual_servo_epipolar.core.laws.two_steps import MATCHING_FEATURES, transitions_by
from visual_servo_epipolar.core.odometry.legs import UNKNOWN_RANGE

AHEAD, STILL_LEFT = 0.5, 0.1  # cosine of a bearing; way at least where bearings say none [m]
TURN_S = 0.5  # time constant of turns to where features stay in view
UNCERTAIN = 0.06  # deviation of the bearings at which the robot drives at half speed [rad]
ON_AXIS, LEAST_ASIDE = 0.2, 0.1  # bearings beyond which D tells no way ahead [rad], [m/s]
RUN_UP = 0.3  # behind the goal, to which a robot backs off that is ahead of it [m]
BACKING = 0.5  # delta and phi backward, below which it backs off onto the axis [rad]
MOST_ASIDE = 0.3  # heading error at which it backs off towards the axis [rad]
TURNING_BEARING = 0.25  # beyond that at which backing off ends: where it turns ahead [rad]
PASSED = 0.05  # beyond which the goal was passed by [m]
HANDOVER_DIFFERENCE = 0.03  # |D| at which two views end as the second step does
HYSTERESIS = 0.35  # beyond where a robot backs off at first, for one on its way [rad]


class Sight(NamedTuple):
    """Where the robot is by now: right and ahead of the goal [m], and the heading error [rad]."""

    x: float
    y: float
    heading: float


def approach(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Twist:
    """Return the velocity of one motion to the goal."""
    sight = seen_from(goal, settings)
    if sight is None:
        return STANDSTILL
    around = steering.goes_around(*sight, goal)
    left = max(way_left(goal), _least_left(goal, settings))
    pose, deviation = steering.polar_pose(*sight), arrival.deviation(goal)
    in_view = not around and steering.goes_around_in_view(pose, goal, settings)
    if around or in_view:
        left = max(left, 0.5 * math.hypot(sight.x, sight.y))  # around is farther than straight
    braking = BRAKING * settings.max_acceleration
    certain = settings.max_linear / (1.0 + (deviation / UNCERTAIN) ** 2)
    speed = min(rate_within(left, deceleration=braking, delay=TAIL_S), certain)
    if in_view:
        return _around_in_view(pose, speed, goal, settings)
    if goal.offset is None and not around:
        aside = goal.bearings is not None and abs(goal.bearings.chi) > ON_AXIS
        least = LEAST_ASIDE if aside else 0.0  # D may be zero far away
        speed = min(speed, max(settings.k_t * abs(goal.difference), least))
    elif speed > 0.0 and not around:
        off = abs(sight.x) + LEAST_LOOK_AHEAD * abs(sight.heading)
        speed = min(speed, converging_speed(off, left, goal, braking, 1.0 + steering.GAINS.k1))
        if settings.max_retreat == 0.0:  # a miss is final
            speed = min(speed, looking_speed(left, goal, settings))
    # What is not known to be aside is no reason to turn.
    unknown = place_deviation(goal) / conditions.LAST_TURN
    look_ahead = max(STEERING_S * abs(speed), LEAST_LOOK_AHEAD, unknown)
    pose = _aimed_pose(sight, look_ahead, around)
    kappa = _visible_curvature(pose, goal)
    speed = min(speed, _steerable(kappa, settings))
    turn = kappa * speed if speed > 0.0 else 0.0
    if around:
        return _around(pose, speed, turn, settings)
    if goal.offset is not None:
        facing = heading_share(left)
        # Near the goal the last turn is half of the next: noise is no reason to turn.
        calm = 0.5 * min(max(1.5 - left / NEAR, 0.0), 1.0)
        turn += calm * (goal.twist.angular - turn)
        turn = (1.0 - facing) * turn - facing * goal.heading_error / TAIL_S
    return Twist(speed, _within_view(turn, goal, settings))


def _aimed_pose(sight: Sight, look_ahead: float, around: bool) -> steering.PolarPose:
    """Return the pose against the goal, or what is aimed at ahead of it, by ``look_ahead`` [m]."""
    ahead = max(steering.GAINS.look_aheads * look_ahead + min(sight.y, 0.0), 0.0)
    if not around:
        return steering.polar_pose(*sight, ahead=ahead)
    # From behind the goal a share of the look-ahead, the less the farther aside.
    share = min(max(2.0 * (1.0 + abs(sight.x) / sight.y), 0.0), 1.0) if sight.y < 0.0 else 0.0
    return steering.on_nearer_side(steering.polar_pose(*sight, ahead=share * ahead))


def _around(pose: steering.PolarPose, speed: float, turn: float, settings: DriveSettings) -> Twist:
    """Return the velocity around the goal: far off its aim the robot turns in place first."""
    if not turns_in_place(settings.drive):
        return Twist(speed, turn)
    off = steering.off_aim(pose)
    share = steering.driving_share(pose.delta, off)
    return Twist(share * speed, share * turn - (1.0 - share) * off / TURN_S)


def _around_in_view(
    pose: steering.PolarPose, speed: float, goal: GoalEstimate, settings: DriveSettings
) -> Twist:
    """Return the velocity around the goal of a wide view: far off its aim it turns in place."""
    low, high = steering.heading_window(goal, steering.RESERVE)
    # Headings from -180 to 180 deg: a turn to one in the window is never the way around the back.
    wanted = steering.aim(pose.phi) - pose.phi
    target = min(max(wanted, low), high)
    left, right = goal.view_margins
    heading = wrap_angle(pose.delta - pose.phi)
    # Turned away by half a turn, it turns back the way that shows the goal.
    middle = heading + 0.5 * (left - right)
    off = heading + wrap_angle(middle) - middle - target
    held = None if target == wanted else pose.phi + target
    kappa = steering.curvature(pose, delta_held=held)
    share = steering.driving_share(pose.delta, off, in_place=2.0 * steering.STEERED)
    speed = min(speed, _steerable(kappa, settings))
    turn = share * kappa * speed - (1.0 - share) * off / TURN_S
    return Twist(share * speed, _within_view(turn, goal, settings))


def _visible_curvature(pose: steering.PolarPose, goal: GoalEstimate) -> float:
    """Return the curvature of the path from ``pose`` [1/m] that keeps features in view."""
    left, right = goal.view_margins
    held = steering.visible_aim(
        steering.aim(pose.phi), pose.delta, (left - steering.RESERVE, right - steering.RESERVE)
    )
    return steering.curvature(pose, delta_held=held)


def way_left(goal: GoalEstimate) -> float:
    """Return the way that is left along the heading [m]; negative past the goal."""
    if goal.offset is not None:
        x, y = goal.offset
        return x * math.sin(goal.heading_error) - y * math.cos(goal.heading_error)
    if goal.bearings is None:
        return 0.0
    return goal.distance(UNKNOWN_RANGE) * math.cos(goal.bearings.current)


def seen_from(goal: GoalEstimate, settings: DriveSettings) -> Sight | None:
    """Return where the robot will be when it obeys, by memory or by bearings; None of neither."""
    if goal.offset is not None:
        x, y = goal.offset
        if goal.place is not None and not goal.mount[0]:
            # The yaw of the camera that places show and no mount has, not known as well from afar.
            x -= goal.place.slip * min(max(y, -NEAR), NEAR)
    elif goal.bearings is not None:
        distance = goal.distance(UNKNOWN_RANGE)
        psi = goal.bearings.psi
        x, y = distance * math.cos(psi), distance * math.sin(psi)
    else:
        return None
    late = unfelt_latency(settings)
    turn, way = goal.twist.angular * late, goal.twist.linear * late
    heading = goal.heading_error
    middle = heading + 0.5 * turn
    return Sight(x - way * math.sin(middle), y + way * math.cos(middle), heading + turn)


def back_off(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Twist:
    """
    Return the velocity backward, on an arc: onto the axis behind the goal, or to a turn ahead.

    From ahead of the goal the same law leads backward onto its axis. From behind it, straight back
    is enough, wherever a wide view would lead. From beside, the robot backs off at the goal's
    heading and turns to where it will drive at the end of that. One that steers turns by driving
    alone, and does not slow down for it.
    """
    if settings.max_retreat == 0.0:
        return STANDSTILL
    sight, speed = seen_from(goal, settings), settings.retreat_speed
    if sight is not None:
        pose = steering.polar_pose(-sight.x, -sight.y, sight.heading, ahead=RUN_UP)
        behind = abs(math.atan2(sight.x, -sight.y)) <= settings.sideways_bearing
        if not behind and steering.goes_around_in_view(
            pose, goal, settings, least=0.0, aside=BACKING
        ):
            twist = _around_in_view(pose, speed, goal, settings)
            return Twist(-twist.linear, twist.angular)
        if max(abs(pose.delta), abs(pose.phi)) < BACKING:
            kappa = _visible_curvature(pose, goal)
            speed = min(speed, _steerable(kappa, settings))
            return Twist(-speed, _within_view(kappa * speed, goal, settings))
    wanted, bearings = 0.0, goal.bearings
    if bearings is not None:
        pose = steering.polar_pose(math.cos(bearings.psi), math.sin(bearings.psi), 0.0)
        beyond = (abs(pose.phi) - settings.retreat_bearing) / TURNING_BEARING
        wanted = math.copysign(MOST_ASIDE * min(max(beyond, 0.0), 1.0), pose.phi)
    left, right = goal.view_margins
    angle = wanted - goal.heading_error
    angle = min(max(angle, steering.RESERVE - right), left - steering.RESERVE)
    if turns_in_place(settings.drive):
        speed *= max(1.0 - abs(angle), 0.0)
    return Twist(-speed, _within_view(angle / TURN_S, goal, settings))


def _steerable(kappa: float, settings: DriveSettings) -> float:
    """Return the speed at which the turn of this curvature is within limits [m/s]."""
    return settings.max_angular / abs(kappa) if kappa else math.inf


def _least_left(goal: GoalEstimate, settings: DriveSettings) -> float:
    """Return the way that is left at least [m], where D says that the goal is ahead and far."""
    bearings = goal.bearings
    if goal.offset is not None or bearings is None or math.cos(bearings.current) < AHEAD:
        return -math.inf
    return STILL_LEFT if goal.difference <= -settings.retreat_difference else -math.inf


def _within_view(turn: float, goal: GoalEstimate, settings: DriveSettings) -> float:
    """
    Return a turn that features stay in view of [rad/s]: the barrier.

    Of what a head can reach, and of where it looks now: no faster than it follows from there.
    """
    # Before features leave its view as it is, a head follows, too.
    margins, follows = goal.present_margins, settings.carrier.turn_rate
    left, right = (follows + _rate_to(margin, settings) for margin in margins)
    turn = min(max(turn, -max(right, 0.0)), max(left, 0.0))
    left, right = (_rate_to(margin, settings) for margin in goal.view_margins)
    if left + right <= 0.0:
        return 0.5 * (left - right)
    return min(max(turn, -right), left)


def _rate_to(margin: float, settings: DriveSettings) -> float:
    """Return the fastest turn towards features that leave the view after a ``margin`` [rad/s]."""
    left, deceleration = margin - steering.RESERVE, settings.max_angular_acceleration
    return rate_within(left, deceleration=deceleration, delay=TURN_S)


def approaching(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
    """Return the event of one motion: lost, beside, missed, or at its end."""
    if goal.is_untrusted(settings.near_parallax):
        return Event.LOST
    if goal.offset is None:
        # A single view without the memory is none; near the goal two views know no direction,
        # and on its axis, where D is small, the second step leads there.
        bearings, near = goal.bearings, abs(goal.difference) <= HANDOVER_DIFFERENCE
        if bearings is None or near and max(abs(bearings.chi), abs(bearings.alpha)) <= ON_AXIS:
            return Event.ALIGNED
        return Event.SIDEWAYS if _lies_beside(goal, settings) else Event.NOTHING
    if memory.settling.settled >= settings.arrival_frames:
        if arrival.has_parallax(goal, memory, settings):
            return missed(memory, settings)
        bound = arrival.facing_bound(goal, memory, settings, spent=True)
        turned = abs(goal.heading_error) > bound
        pulses = arrival.ends_by_pulses(goal, settings)
        return Event.TURNED if turned and pulses else Event.MATCHED
    x, y = goal.offset
    pose = steering.polar_pose(x, y, goal.heading_error)
    all_round = steering.goes_around(x, y, goal.heading_error, goal)
    if all_round or steering.goes_around_in_view(pose, goal, settings):
        return Event.NOTHING
    if not memory.settling.settled and y > -PASSED and max(y, abs(x)) > PASSED:
        return missed(memory, settings)
    beside = y < -steering.AT_GOAL and _lies_beside(goal, settings)
    return Event.SIDEWAYS if beside else Event.NOTHING


def _lies_beside(
    goal: GoalEstimate,
    settings: DriveSettings,
    *,
    beyond: float = HYSTERESIS,
    least: float = steering.KEPT_SHARE,
) -> bool:
    """
    Return whether the goal lies beside, ``beyond`` [rad] of where a robot backs off to.

    It does not where a wide view leads around it with the ``least`` share of the distance left.
    """
    bearings = goal.bearings
    if bearings is None or not settings.options.retreat or steering.sees_all_round(goal):
        return False
    pose = steering.polar_pose(
        math.cos(bearings.psi), math.sin(bearings.psi), bearings.heading_error
    )
    if steering.leads_around(pose, goal, settings, least=least):
        return False
    return (
        not conditions.is_behind(bearings)
        or abs(bearings.chi) > settings.sideways_bearing + beyond
    )


def missed(memory: Memory, settings: DriveSettings) -> Event:
    """Return the event of a miss: a new attempt backs off first, as far as that is allowed."""
    repeats = settings.options.new_attempts and settings.options.retreat
    again = repeats and memory.run.attempts < settings.max_attempts
    return Event.MISSED if again else Event.EXHAUSTED


def _ends(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> bool:
    """
    Return whether the motion ends here, along the axis and in heading, both by a memory.

    A base with a dead band turns by pulses, in place, which end finer than those on the way.
    """
    if goal.offset is None:
        return False
    rest = 1.0 / _decay(goal, memory, settings)
    # What is not known of the heading counts as zero.
    known = min(goal.heading_deviation, arrival.FACING, settings.arrival_heading)
    turned = abs(goal.heading_error) > rest * max(
        arrival.facing_bound(goal, memory, settings), known
    )
    stands = memory.settling.rest is not None and arrival.ends_by_pulses(goal, settings)
    if turned and not stands:
        return False
    through = is_through(goal, memory, settings, rest=rest)
    return through or arrival.is_near_enough(goal, memory, settings)


def _decay(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> float:
    """
    Return the share of what is left now that is left when the last frame has settled.

    It decays with TAIL_S, so that the robot may settle before it is at the end: each
    frame asks for less, the last one for nothing beyond the bounds. A base with a dead band stops
    where it is.
    """
    if max(settings.dead_band_linear, settings.dead_band_angular) > 0.0:
        return 1.0
    frames = max(settings.arrival_frames - 1 - memory.settling.settled, 0)
    return math.exp(-frames * usual_step(goal.period) / TAIL_S)


def is_through(
    goal: GoalEstimate,
    memory: Memory,
    settings: DriveSettings,
    *,
    rest: float = 1.0,
    spent: bool = False,
) -> bool:
    """
    Return whether the motion leads no farther, by a memory: D is zero, or the way left.

    Aside of the goal they are not zero at one place, and the motion stands where the way ends.
    """
    bound = rest * arrival.matched_bound(goal, memory, settings, spent=spent)
    left = abs(way_left(goal)) * goal.difference_slope
    return goal.offset is not None and min(abs(goal.difference), left) <= bound


def retreating(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
    """Return the event of backing off: whether the goal lies ahead by now."""
    if goal.is_untrusted(settings.near_parallax):
        return Event.LOST
    has_room = has_run_up(goal, memory, settings) and conditions.is_far_enough(goal, settings)
    if goal.bearings is None or not has_room:
        return Event.NOTHING
    return Event.NOTHING if _lies_beside(goal, settings, beyond=0.0, least=1.0) else Event.APART


def surveyed(row: PhaseRow) -> PhaseRow:
    """Return the row of a robot that stands: one motion begins wherever the goal is known."""

    def classify(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
        event = row.classify(goal, memory, settings)
        if event is Event.SIDEWAYS and not _lies_beside(
            goal, settings, beyond=steering.RESERVE, least=steering.LEAST_SHARE
        ):
            event = Event.APART
        known = goal.offset is not None or goal.bearings is not None
        return Event.APART if known and event in (Event.ALIGNED, Event.NO_BASELINE) else event

    return replace(row, classify=classify)


APPROACHING = PhaseRow(
    phase=Phase('approaching', drives=True, closes_in=True, straight=True),
    words='drives to the goal in one motion',
    colour='#117733',
    classify=approaching,
    command=approach,
    is_settled=_ends,
    is_close=partial(is_through, spent=True),
    begin=lambda goal, memory, _: conditions.with_new_leg(goal, memory),
)
ONE_MOTION = StateMachine(
    (
        *(surveyed(WAITING), surveyed(HOLDING), ARRIVED, FAILED, ORIENTING, MATCHING_FEATURES),
        replace(RETREATING, classify=retreating, command=back_off),
        APPROACHING,
    ),
    {
        **transitions_by(APPROACHING.phase),
        (APPROACHING.phase, Event.SIDEWAYS): Phase.RETREATING,
        (APPROACHING.phase, Event.ALIGNED): Phase.MATCHING_FEATURES,
        (APPROACHING.phase, Event.MATCHED): Phase.ARRIVED,
        (APPROACHING.phase, Event.MISSED): Phase.RETREATING,
        (APPROACHING.phase, Event.TURNED): Phase.ORIENTING,
    },
)
