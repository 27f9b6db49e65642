"""
Two steps: the laws of the paper, which zero the epipoles, then match the features.

Displacing is the turn in place that brings e_au to where step 1 can begin; step 1 zeroes the
epipoles, onto the axis of the photograph, eqs. (16)-(17); step 2 drives straight until the
features match, eqs. (21)-(22).
"""

from functools import partial
import math

from visual_servo_epipolar.core.arrays import ROUNDING
from visual_servo_epipolar.core.estimate.goal_estimate import GoalEstimate
from visual_servo_epipolar.core.estimate.settings import DEPARTURES, DriveSettings
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import saturate, STANDSTILL, Twist
from visual_servo_epipolar.core.laws import arrival, braking, conditions, equations
from visual_servo_epipolar.core.laws.derived_gains import (
    gains_in_use,
    legal_target,
    with_gains_of_now,
)
from visual_servo_epipolar.core.laws.machine import Law, PhaseRow, StateMachine
from visual_servo_epipolar.core.laws.memory import Memory, yaw_learnt
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.standing import (
    ARRIVED,
    FAILED,
    HOLDING,
    ORIENTING,
    RETREATING,
    WAITING,
)
from visual_servo_epipolar.core.odometry.legs import UNKNOWN_RANGE
from visual_servo_epipolar.core.reasons import Reason

MOST_RESTARTS = 12  # of step 1 in an attempt: it goes to and fro
CREEP = 0.02  # least speed under contact braking, lest noise in the rate stop the robot [m/s]
YAW_FOR_NEW_START = math.radians(1.5)  # that the camera may be learnt to differ by in this phase
LARGEST_ESCAPE = 0.1  # [rad]
DOUBTFUL_LOOKS = 3  # times the frames of one that is sure: the noise has to be known
YAW_FOR_NEW_ATTEMPT = math.radians(0.5)  # that the camera is learnt to differ by in this phase


def _displaced(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
    if goal.bearings is None:
        return Event.LOST
    alpha = goal.bearings.alpha
    if abs(goal.bearings.chi) <= arrival.engage_bound(goal, settings):
        return Event.DISPLACED  # e_du is zero already: any e_au will do
    if not settings.options.discordant_turn and not settings.derives:
        return Event.DISPLACED if abs(alpha) > settings.singular_epipole else Event.NOTHING
    off = alpha - math.atan(memory.law.target)
    if settings.options.speed_ramps:  # also once it stands
        turn = arrival.stopping(goal.twist.angular, settings.max_angular_acceleration, settings)
        off = max(off, off + turn, key=abs)
    return Event.DISPLACED if abs(off) <= settings.displacement_tolerance else Event.NOTHING


def _displace(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Twist:
    """Return the turn in place of e_au to its target (section IV-B, remarks)."""
    if goal.bearings is None:
        return STANDSTILL
    bearings = goal.bearings
    if settings.options.speed_ramps:
        angle = math.atan(memory.law.target) - bearings.alpha
        return Twist(0.0, braking.braked_turn(angle, goal, settings))
    return equations.turn_epipole(
        bearings.epipole_current, memory.law.target, k1=settings.turn_gain
    )


def _begin_displacing(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Memory:
    """
    Return ``memory`` with a new leg, and the target of e_au.

    ValueError if none is legal, or step 1 was given up too often in this attempt.
    """
    if memory.run.restarts >= MOST_RESTARTS and settings.options.speed_ramps:
        raise ValueError(Reason.RESTARTED.of(memory.run.restarts))
    memory = conditions.with_new_leg(goal, memory)
    bearings = goal.bearings
    if settings.derives:
        target = legal_target(goal, memory, settings)
    elif bearings is None:
        target = 0.0
    elif settings.options.discordant_turn:
        target = math.tan(conditions.discordant_bearing(goal, settings))
    else:  # section IV-B, remarks
        target = math.copysign(math.tan(2.0 * settings.singular_epipole), bearings.epipole_current)
    return memory.changed(target=target)


DISPLACING = PhaseRow(
    phase=Phase.DISPLACING,
    words='turns, to begin step 1 with the goal on the right side',
    colour='#56B4E9',
    classify=_displaced,
    command=_displace,
    begin=_begin_displacing,
)


def _zeroed(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
    if goal.bearings is None:
        return Event.NO_BASELINE if goal.parallax <= settings.near_parallax else Event.LOST
    chi = goal.bearings.chi
    if abs(chi) >= settings.divergence:
        return Event.DIVERGED
    factor = arrival.hysteresis(memory, settings)
    turned = yaw_learnt(goal, memory) > factor * YAW_FOR_NEW_START
    off_course = conditions.is_sideways(goal, settings, factor=factor)
    if not memory.law.latched and not turned and off_course:
        return Event.ALIGNED if conditions.leads_home(goal, settings) else Event.SIDEWAYS
    if memory.law.latched:
        escaped = abs(chi) > escape_bound(goal, memory, settings)
    else:
        escaped = leads_away(goal, settings, factor=factor)
    if escaped or (turned and not _goes_on(goal, memory, settings)):
        return conditions.begun_step_1(goal, settings, Event.ESCAPED)
    return Event.ALIGNED if memory.settling.settled >= settings.align_frames else Event.NOTHING


def _goes_on(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> bool:
    """Return whether step 1 leads home as it is, though the yaw of the camera is another."""
    if not settings.options.line_following or goal.bearings is None:
        return False
    if memory.law.latched:
        return True
    # The spiral of the held e_au, as in ``equations.displaced_epipole``.
    least_tangent = abs(goal.bearings.chi) / math.log(1.0 / settings.least_spiral_ratio)
    sideways = conditions.is_sideways(goal, settings, factor=1.0)
    return abs(memory.law.target) >= least_tangent and not sideways


def escape_bound(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> float:
    """
    Return the bearing of e_du [rad] beyond which step 1 has to begin anew.

    An offset of which line following leaves little, twice as much as where step 2 begins without
    step 1, need not be zeroed first, as when a
    camera ahead of the axle swings aside while the robot turns: to begin anew would displace e_au
    by as much, and the camera would swing aside once more.
    """
    bound = arrival.hysteresis(memory, settings) * arrival.release_bound(goal, settings)
    if not settings.options.line_following:
        return bound
    distance = goal.distance(UNKNOWN_RANGE)
    ratio = max(conditions.offset_ratio(distance, goal, settings), ROUNDING)
    most = 2.0 * conditions.RESIDUAL_OFFSET / ratio
    return max(bound, min(most / distance, LARGEST_ESCAPE))


def leads_away(goal: GoalEstimate, settings: DriveSettings, *, factor: float = 1.0) -> bool:
    """
    Return whether both epipoles are on one side, from where step 1 drives away from the goal.

    e_au is turned to the other side first, but on the sign that e_du had then: it may have been
    lost in noise, or that of a mount that was taken for another.
    """
    law, bearings = settings.options, goal.bearings
    if bearings is None or not (law.discordant_turn and law.retreat):
        return False
    known = abs(bearings.chi) > factor * arrival.release_bound(goal, settings)
    return known and bearings.alpha * bearings.chi > 0.0


def _zero_epipoles(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Twist:
    """Return eqs. (16)-(17), braked before contact if the law says so."""
    bearings, law = goal.bearings, settings.options
    if bearings is None:
        return STANDSTILL
    if memory.law.latched and _turns_back(memory, settings):
        return Twist(0.0, braking.braked_turn(-bearings.alpha, goal, settings))
    nu = _auxiliary_controls(bearings, goal, memory, settings)
    epipoles = bearings.epipole_current, bearings.epipole_desired
    twist = equations.linearizing_control(
        *epipoles,
        sigma=bearings.sigma if law.true_sigma else equations.printed_sigma(*epipoles),
        distance=goal.motion.distance,
        nu=(nu[0], 0.0) if memory.law.latched else nu,
    )
    if not law.contact_braking:
        return twist
    rate, most = memory.law.desired_rate, settings.braking
    speed = equations.braking_speed(bearings.chi, rate, deceleration=most)
    return saturate(twist, max_linear=max(speed, CREEP), max_angular=math.inf)


def _turns_back(memory: Memory, settings: DriveSettings) -> bool:
    """Return whether a turn in place that brakes zeroes e_au, not the controls of the law."""
    own = settings.options.epipole_controls is None and gains_in_use(memory, settings) is None
    return own and settings.options.speed_ramps


def _auxiliary_controls(
    bearings: Bearings, goal: GoalEstimate, memory: Memory, settings: DriveSettings
) -> tuple[float, float]:
    """Return (nu_1, nu_2) of the law; a discordant turn holds e_au until e_du is latched."""
    law = settings.options
    gains = _first_gains(memory, settings)
    if law.discordant_turn and not memory.law.latched and not settings.finite_time:
        gains['e_target'] = _held_epipole(goal, memory)
    finite = settings.finite_time
    usual = equations.finite_time_controls if finite else equations.auxiliary_controls
    controls = law.epipole_controls or usual
    return controls(bearings.epipole_current, bearings.epipole_desired, **gains)


def _first_gains(memory: Memory, settings: DriveSettings) -> dict[str, float]:
    """Return k1, k2 and the exponent of (12), given or derived; a held e_au has the turn gain."""
    derived, holds = gains_in_use(memory, settings), settings.options.discordant_turn
    k1 = settings.turn_gain if holds else settings.k1
    if derived is None:
        return {'k1': k1, 'k2': settings.k2, 'exponent': settings.exponent}
    if holds:
        k1 = min(k1, derived.k1_alone)
    else:
        k1 = derived.k1_alone if memory.law.latched else derived.k1
    return {'k1': k1, 'k2': derived.k2, 'exponent': derived.exponent}


def _held_epipole(goal: GoalEstimate, memory: Memory) -> float:
    """Return the abscissa to hold e_au at: the target, as far as features stay in view."""
    if goal.bearings is None:
        return memory.law.target
    alpha, (left, right) = goal.bearings.alpha, goal.view_margins
    return math.tan(min(max(math.atan(memory.law.target), alpha - right), alpha + left))


def _are_zero(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> bool:
    """Return whether both epipoles are zero, or so small that step 2 leads home from here."""
    if not memory.law.latched or goal.bearings is None:
        return False
    if _turns_back(memory, settings) and conditions.leads_home(goal, settings):
        return True
    return abs(goal.bearings.alpha) <= arrival.align_bound(goal, memory, settings)


def _observe(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Memory:
    """Latch e_du at zero, once it is small or of the other sign, until a new phase."""
    if memory.law.latched or goal.bearings is None:
        return memory
    bearing = goal.bearings.chi
    near = abs(bearing) <= arrival.engage_bound(goal, settings)
    return memory.changed(latched=near or bearing * memory.law.side < 0.0)


ZEROING_EPIPOLES = PhaseRow(
    phase=Phase.ZEROING_EPIPOLES,
    words='drives onto the axis of the photograph (step 1)',
    colour='#0072B2',
    classify=_zeroed,
    command=_zero_epipoles,
    is_settled=_are_zero,
    begin=lambda goal, memory, settings: with_gains_of_now(
        goal, conditions.with_new_leg(goal, memory), settings
    ),
    observe=_observe,
)


def _matched(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Event:
    if goal.is_untrusted(settings.near_parallax):
        return Event.LOST
    attempts_remain = memory.run.attempts < settings.max_attempts
    repeats = settings.options.new_attempts and attempts_remain
    if repeats and arrival.stands_beside(goal, memory, settings):
        return Event.MISSED
    # In doubt a few looks suffice where the robot stands clearly aside.
    looks_aside = abs(memory.settling.settled_aside) > arrival.SURE_DEVIATIONS
    sure = looks_aside and memory.run.attempts == 1
    looks = DOUBTFUL_LOOKS if arrival.is_in_doubt(goal, settings) and not sure else 1
    if memory.settling.settled < looks * settings.arrival_frames:
        return Event.NOTHING
    missed = Event.MISSED if repeats else Event.EXHAUSTED
    if arrival.has_parallax(goal, memory, settings):
        # Within a tolerance of the owner's alone it is no miss: it goes on, nearer.
        return missed if arrival.is_matched(goal, memory, settings) else Event.NOTHING
    if repeats and goal.offset is None and yaw_learnt(goal, memory) > YAW_FOR_NEW_ATTEMPT:
        return Event.MISSED  # aside by as much as two views cannot tell
    if arrival.faces_goal(goal, memory, settings):
        return Event.MATCHED
    if settings.options.final_turn:
        return Event.TURNED
    return missed if settings.arrival_heading > arrival.FACING else Event.MATCHED


def _match(goal: GoalEstimate, memory: Memory, settings: DriveSettings) -> Twist:
    """Return eqs. (21)-(22), or their u_1 with line following instead of u_2 = 0."""
    control = settings.options.matching_control or equations.match_features
    difference = goal.difference
    if _brakes(goal, settings):
        difference += (
            goal.motion.slope.value * goal.twist.linear * braking.unfelt_latency(settings)
        )
    twist = control(difference, k_t=_matching_gain(difference, goal, memory, settings))
    if not settings.options.line_following:
        return twist
    fastest = min(settings.max_linear, _converging_speed(goal, settings))
    linear = min(max(twist.linear, -settings.max_linear), fastest)
    length = conditions.line_look_ahead(goal, settings)
    if _brakes(goal, settings):  # in time no less than a loop can follow
        length = max(length, braking.STEERING_S * abs(linear))
    twist = equations.follow_line(
        linear,
        conditions.lateral_offset(goal),
        goal.heading_error,
        look_ahead=length,
        least_turn=arrival.half_hop(settings.dead_band_angular, goal, memory, settings),
    )
    if not _brakes(goal, settings) or goal.offset is None or not settings.options.final_turn:
        return twist
    facing = braking.heading_share(goal.offset[1])
    turn = braking.settled_turn(-goal.heading_error, goal, settings)
    return Twist(linear, (1.0 - facing) * twist.angular + facing * turn)


def _converging_speed(goal: GoalEstimate, settings: DriveSettings) -> float:
    """Return the speed at which line following ends on the axis, by a memory of views [m/s]."""
    if goal.offset is None or not _brakes(goal, settings):
        return math.inf
    x, y = goal.offset
    if y >= 0.0:
        return math.inf
    deceleration = braking.BRAKING * settings.max_acceleration
    aside = abs(x) + braking.LEAST_LOOK_AHEAD * abs(goal.heading_error)
    speed = braking.converging_speed(aside, -y, goal, deceleration, 1.0)
    return min(speed, braking.looking_speed(-y, goal, settings))


def _matching_gain(
    difference: float, goal: GoalEstimate, memory: Memory, settings: DriveSettings
) -> float:
    """Return k_t of (21) [m/s]: given, derived, or a rate over the slope of D once it is known."""
    derived = gains_in_use(memory, settings)
    k_t = settings.k_t if derived is None else derived.k_t
    if not settings.options.slope_gain or not goal.motion.slope.value > 0.0:
        return k_t
    rate = settings.approach_rate
    rate = min(k_t * goal.motion.slope.value, rate) if derived is None else min(derived.rate, rate)
    way = difference / goal.motion.slope.value
    if way and _brakes(goal, settings):
        deceleration, band = braking.BRAKING * settings.max_acceleration, settings.dead_band_linear
        rate = (
            braking.braked(way, goal, gain=rate, deceleration=deceleration, dead_band=band) / way
        )
    return rate / goal.motion.slope.value


def _brakes(goal: GoalEstimate, settings: DriveSettings) -> bool:
    """Return whether step 2 ends at a constant deceleration: its way is known, gains are given."""
    law = settings.options
    known = law.slope_gain and goal.motion.slope.value > 0.0
    return known and law.speed_ramps and not settings.derives


MATCHING_FEATURES = PhaseRow(
    phase=Phase.MATCHING_FEATURES,
    words='drives straight until the features match (step 2)',
    colour='#009E73',
    classify=_matched,
    command=_match,
    is_settled=lambda *seen: arrival.is_near_enough(*seen) or arrival.is_matched(*seen),
    is_close=partial(arrival.is_matched, spent=True),
    begin=with_gains_of_now,
)


def transitions_by(drive: Phase) -> dict[tuple[Phase, Event], Phase]:
    """Return the transitions that laws share, whose way to the goal begins with ``drive``."""
    survey = {  # of the situation: at the start, and after tracks came back
        Event.SIDEWAYS: Phase.RETREATING,
        Event.APART: drive,
        Event.ALIGNED: Phase.MATCHING_FEATURES,
        Event.MATCHED: Phase.ARRIVED,
    }
    standing = {
        Event.NO_BASELINE: Phase.ORIENTING,
        Event.AMBIGUOUS: Phase.MATCHING_FEATURES,
        Event.AMBIGUOUS_NEAR: Phase.RETREATING,
        **survey,
    }
    return {
        **{(Phase.WAITING, event): phase for event, phase in standing.items()},
        **{(Phase.HOLDING, event): phase for event, phase in standing.items()},
        **{(Phase.ORIENTING, event): phase for event, phase in survey.items()},
        (Phase.RETREATING, Event.APART): drive,
        (Phase.RETREATING, Event.RESOLVED): Phase.HOLDING,
        (Phase.MATCHING_FEATURES, Event.RESOLVED): Phase.HOLDING,
        (Phase.MATCHING_FEATURES, Event.NO_GAIN): Phase.FAILED,
        (Phase.MATCHING_FEATURES, Event.MATCHED): Phase.ARRIVED,
        (Phase.MATCHING_FEATURES, Event.TURNED): Phase.ORIENTING,
        (Phase.MATCHING_FEATURES, Event.MISSED): Phase.RETREATING,
    }


TWO_STEPS = StateMachine(
    (
        *(WAITING, HOLDING, ARRIVED, FAILED, ORIENTING, RETREATING),
        *(DISPLACING, ZEROING_EPIPOLES, MATCHING_FEATURES),
    ),
    {
        **transitions_by(Phase.DISPLACING),
        (Phase.RETREATING, Event.ALIGNED): Phase.MATCHING_FEATURES,
        (Phase.DISPLACING, Event.DISPLACED): Phase.ZEROING_EPIPOLES,
        (Phase.DISPLACING, Event.NO_GAIN): Phase.FAILED,
        (Phase.ZEROING_EPIPOLES, Event.ALIGNED): Phase.MATCHING_FEATURES,
        (Phase.ZEROING_EPIPOLES, Event.SIDEWAYS): Phase.RETREATING,
        (Phase.ZEROING_EPIPOLES, Event.ESCAPED): Phase.DISPLACING,
        (Phase.ZEROING_EPIPOLES, Event.NO_BASELINE): Phase.ORIENTING,
        (Phase.ZEROING_EPIPOLES, Event.NO_GAIN): Phase.DISPLACING,
    },
)

PAPER = Law(new_attempts=True)
CORRECTED = PAPER.changed({'true_sigma': True})
FULL = PAPER.changed(dict.fromkeys(DEPARTURES, True))
