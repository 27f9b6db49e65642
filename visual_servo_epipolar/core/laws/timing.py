"""
Timing: how long a phase and the run have lasted, by the stamps of images, and late commands.

The clock of the stamps is not ours: it may be set while the robot drives. Where it leaps, the
stamps at which phase and run began are moved along, so that limits count the time that passed,
one usual period, and go on by the new clock.

Laws go by where the robot will be when it obeys, where it obeys late: what was commanded and has
not acted yet is driven ahead from where the robot is seen (Smith 1957; Artstein 1982). The loop is
then as without the delay, but for what the base does otherwise. Events go by what is seen, and a
robot that has settled must be there when all has acted, too.
"""

from dataclasses import replace
import math

from visual_servo_epipolar.core.estimate.base_model import BORNE
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.laws.state import DriveState, StateT
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.reasons import Reason
from visual_servo_epipolar.core.stamps import NANOSECONDS, NOT_ADVANCING, seconds_between

MAX_STEP_S = 1.0  # a longer gap between two images is not integrated over
HALF_TURNS = 3.0  # at full speed, that no turn in place takes
USUAL_STEP_S = 0.1  # between two images, where no others came before


def time_step(state: DriveState, stamp_ns: int) -> float:
    """Return the time from the last image to ``stamp_ns`` to integrate over [s]."""
    if state.measurement is None:
        return 0.0
    return min(max(seconds_between(state.measurement.stamp_ns, stamp_ns), 0.0), MAX_STEP_S)


def clock_jump(state: DriveState, stamp_ns: int, settings: DriveSettings) -> str:
    """
    Return in words how the stamps leap to ``stamp_ns`` from the last image; empty if they do not.

    They must advance. A driving robot has an image before the last is stale; a standing one may
    have waited for as long as the stamps say.
    """
    if state.measurement is None:
        return ''
    gap = seconds_between(state.measurement.stamp_ns, stamp_ns)
    if gap <= 0.0:
        return NOT_ADVANCING
    if not state.phase.drives or gap <= max(settings.stale_timeout, MAX_STEP_S):
        return ''
    return Reason.STAMPS_LEAPT.of(gap)


def usual_step(state: DriveState) -> float:
    """Return the time that usually passes between two images [s]."""
    return state.view.period if state.view.period > 0.0 else USUAL_STEP_S


def after_clock_jump(state: StateT, stamp_ns: int) -> StateT:
    """Return ``state`` by the clock that leapt to ``stamp_ns``: one usual period has passed."""
    if state.measurement is None:
        return state
    passed_ns = round(usual_step(state) * NANOSECONDS)
    leap_ns = stamp_ns - state.measurement.stamp_ns - passed_ns
    return state.changed(
        phase_start_ns=state.run.phase_start_ns + leap_ns,
        run_start_ns=state.run.run_start_ns + leap_ns,
    )


def has_timed_out(state: DriveState, measurement: Measurement, settings: DriveSettings) -> bool:
    """Return whether the run or the phase has lasted too long; waiting may last for ever."""
    if not state.phase.runs:
        return False
    holding = state.phase is Phase.HOLDING
    run_time = seconds_between(state.run.run_start_ns, measurement.stamp_ns)
    phase_time = seconds_between(state.run.phase_start_ns, measurement.stamp_ns)
    timeout = settings.holding_timeout if holding else phase_timeout(state.phase, settings)
    return run_time > settings.run_timeout or phase_time > timeout


def phase_timeout(phase: Phase, settings: DriveSettings) -> float:
    """
    Return how long a ``phase`` may last [s]: a turn in place that brakes as long as some turns.

    One that takes longer swings about its aim: it looks larger than it is.
    """
    if phase is not Phase.DISPLACING or not settings.options.speed_ramps:
        return settings.phase_timeout
    slowest = settings.max_speed_ratio * settings.max_angular
    half_turn = math.pi / slowest + slowest / settings.max_angular_acceleration
    return min(settings.phase_timeout, HALF_TURNS * half_turn)


def predicted(state: StateT, settings: DriveSettings) -> StateT:
    """Return ``state`` with its measurement as it will be when the next command acts."""
    measurement = state.measurement
    if measurement is None or not state.phase.drives or not is_late(settings):
        return state
    now_ns = measurement.stamp_ns
    late_ns = round(settings.latency * NANOSECONDS)
    turn, right, ahead = 0.0, 0.0, 0.0
    for span, twist in state.motion.sent.acting(now_ns, now_ns + late_ns, settings.latency):
        heading = measurement.heading_error + turn + 0.5 * twist.angular * span
        right -= twist.linear * span * math.sin(heading)
        ahead += twist.linear * span * math.cos(heading)
        turn += twist.angular * span
    return state.changed(measurement=_moved(measurement, state, (right, ahead), turn))


def _moved(
    measurement: Measurement, state: DriveState, way: tuple[float, float], turn: float
) -> Measurement:
    """Return ``measurement`` after a ``way``, right and ahead [m], and a ``turn`` [rad]."""
    heading = math.remainder(measurement.heading_error + turn, 2.0 * math.pi)
    left, right = measurement.view_margins
    slope = measurement.difference_slope
    slope = slope if slope > 0.0 else state.motion.slope.value
    rise = slope * way[1] if slope > 0.0 else 0.0
    moved = replace(
        measurement,
        heading_error=heading,
        rotation_heading=math.remainder(measurement.rotation_heading + turn, 2.0 * math.pi),
        difference=measurement.difference + rise,
        view_margins=(max(left - turn, 0.0), max(right + turn, 0.0)),
    )
    if measurement.offset is not None:
        offset = measurement.offset[0] + way[0], measurement.offset[1] + way[1]
        moved = replace(moved, offset=offset)
    if measurement.bearings is None:
        return moved
    psi, distance = measurement.bearings.psi, goal_distance(state, measurement)
    x, y = distance * math.cos(psi) + way[0], distance * math.sin(psi) + way[1]
    psi = math.atan2(y, x)
    phi = math.remainder(psi - heading - 0.5 * math.pi, 2.0 * math.pi)
    return replace(moved, bearings=Bearings(psi, phi))


def goal_distance(state: DriveState, measurement: Measurement) -> float:
    """Return the distance from the goal, as well as it is known [m]."""
    if measurement.offset is not None:
        return math.hypot(*measurement.offset)
    if state.view.estimate is not None and state.view.estimate.range > 0.0:
        return state.view.estimate.range
    return state.motion.range if state.motion.range > 0.0 else state.motion.distance


def is_late(settings: DriveSettings) -> bool:
    """Return whether the base obeys so late that laws must look ahead."""
    return settings.options.anticipation and settings.latency > BORNE


def felt_latency(settings: DriveSettings) -> float:
    """Return the delay that laws still feel [s]: none is longer than they bear."""
    return min(settings.latency, BORNE) if is_late(settings) else settings.latency
