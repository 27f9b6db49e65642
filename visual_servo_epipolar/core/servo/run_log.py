"""Run log: the record of one run, from which figures, files, sweeps and the verdict are made."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import groupby, pairwise
import math
from typing import Any

from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.stamps import NANOSECONDS

BESIDE = 0.65  # bearing off the goal's axis: no way straight ahead keeps it in view [rad]
MOST_TURNED = 0.5  # heading error with which a robot beside the goal moves aside at most [rad]
SETTLE_FRAMES = 6  # the base may still be braking when the servo says that it has arrived
LEAST_STANDSTILL_S = 0.3  # for which a robot stands on its way: longer than a cusp takes
AT_GOAL_M = 0.02  # a robot this near the goal has arrived, for whoever watches it
WRONG_M, WRONG_DEG = 0.05, 2.0  # an arrival farther off is wrong, and the robot does not say so
LEAST_REVERSED = {'v': 0.01, 'w': 0.05}  # slower commands are no motion to and fro [m/s, rad/s]


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Limits of the base: speeds ahead and back [m/s], speeding up and slowing down [m/s^2]."""

    speed: float
    backward: float
    acceleration: float
    deceleration: float

    @classmethod
    def of(cls, settings: DriveSettings) -> 'MotionLimits':
        """Return the limits that the servo keeps."""
        speed, faster = settings.max_linear * settings.max_speed_ratio, settings.max_acceleration
        return cls(speed, min(settings.retreat_speed, speed), faster, 2.0 * faster)

    def time(self, way: float, speed: float) -> float:
        """Return the least time of a straight ``way`` [m] from standstill to standstill [s]."""
        ramps = 1.0 / self.acceleration + 1.0 / self.deceleration
        if way < 0.5 * speed * speed * ramps:
            return math.sqrt(2.0 * way * ramps)
        return way / speed + 0.5 * speed * ramps


def least_time(start: Pose, limits: MotionLimits) -> float:
    """
    Return T_0, the least time from ``start`` to the goal within ``limits`` [s].

    From behind the goal it is that of the straight way, d_0 / v + v/2 (1/a + 1/b). From more than
    BESIDE off the goal's axis features would leave the view on it: the least way is one back and
    one ahead, both as far aside as a heading error of MOST_TURNED leads.
    """
    behind, aside = -start.y, abs(start.x)
    if aside <= behind * math.tan(BESIDE):
        return limits.time(start.distance, limits.speed)
    ahead = behind / math.cos(MOST_TURNED)
    way = max(aside / math.sin(MOST_TURNED), abs(ahead))
    back = 0.5 * (way - ahead)
    return limits.time(back, limits.backward) + limits.time(way - back, limits.speed)


@dataclass(frozen=True, slots=True)
class Sample:
    """
    Sample of one control step: ground truth, measurement, command.

    ``pose`` is ground truth, which the servo never gets; ``twist`` is commanded [m/s, rad/s].
    Epipoles are abscissae from the principal point [px], nan where undefined; bearings are those
    of the other camera's centre [rad], right positive. ``feature_difference`` is D of eq. (23)
    [px^2], compensated for rotation if the law asks for it; ``feature_error`` is the median angle
    between current and desired features, as pixels at the image centre [px];
    ``distance_estimate`` is d_hat [m].
    """

    stamp_ns: int
    pose: Pose
    twist: Twist = STANDSTILL
    phase: Phase = Phase.WAITING
    features: int = 0
    epipole_current: float = math.nan
    epipole_desired: float = math.nan
    bearing_current: float = math.nan
    bearing_desired: float = math.nan
    feature_difference: float = math.nan
    feature_error: float = math.nan
    distance_estimate: float = math.nan


@dataclass(frozen=True, slots=True)
class RunLog:
    """
    Record of one run: its start, its samples in order of time, its outcome.

    ``start`` is x [m], y [m] and heading error [deg]; ``outcome`` is 'arrived' or 'failed';
    ``limits`` are those of the base, None where they are unknown; ``field_of_view`` is how far
    around the camera saw [rad], None likewise.
    """

    start: tuple[float, float, float]
    seed: int
    samples: Sequence[Sample]
    outcome: str
    reason: str
    attempts: int = 1
    law: str = 'full'
    limits: MotionLimits | None = None
    field_of_view: float | None = None


@dataclass(frozen=True, slots=True)
class PhaseSpan:
    """Span of time in one phase, of ``name``, from ``start_s`` to ``end_s`` of the run [s]."""

    name: str
    start_s: float
    end_s: float


def seconds(log: RunLog) -> list[float]:
    """Return the time of each sample since the first [s]."""
    first = log.samples[0].stamp_ns
    return [(sample.stamp_ns - first) / NANOSECONDS for sample in log.samples]


def phase_spans(log: RunLog) -> list[PhaseSpan]:
    """Return the spans of the phases of a run, one after the other."""
    times = seconds(log)
    words = [(sample.phase.value, time) for sample, time in zip(log.samples, times, strict=True)]
    starts = [next(group) for _, group in groupby(words, key=lambda each: each[0])]
    ends = [*(time for _, time in starts[1:]), times[-1]]
    return [PhaseSpan(*start, end) for start, end in zip(starts, ends, strict=True)]


def end_s(log: RunLog) -> float:
    """Return the time at which the servo arrived or failed, or of the last sample if neither."""
    last = phase_spans(log)[-1]
    return last.start_s if log.samples[-1].phase.ended else last.end_s


def summarise(log: RunLog) -> dict[str, Any]:
    """Return the verdict on a run: the JSON of the command line, errors of the final true pose."""
    poses = [sample.pose for sample in log.samples]
    final, distance_0 = poses[-1], poses[0].distance
    idle = (Phase.WAITING, Phase.FAILED)
    return {
        'outcome': log.outcome,
        'reason': log.reason,
        'start': list(log.start),
        'seed': log.seed,
        'law': log.law,
        'position_error_m': final.distance,
        'lateral_error_m': final.x,
        'longitudinal_error_m': final.y,
        'heading_error_deg': math.degrees(final.heading_error),
        'duration_s': seconds(log)[-1],
        'path_length_m': sum(math.hypot(b.x - a.x, b.y - a.y) for a, b in pairwise(poses)),
        'max_distance_ratio': max(p.distance for p in poses) / distance_0 if distance_0 else None,
        'min_visible_features': min(
            (sample.features for sample in log.samples if sample.phase not in idle), default=0
        ),
        'max_linear_speed': max(abs(sample.twist.linear) for sample in log.samples),
        'max_angular_speed': max(abs(sample.twist.angular) for sample in log.samples),
        'phases': [asdict(span) for span in phase_spans(log)],
        'attempts': log.attempts,
        **_smoothness(log),
    }


def kind(result: Mapping[str, Any]) -> str:
    """Return how a run ended, by its document: arrived, wrong, failed, or raised by a defect."""
    if 'traceback' in result:
        return 'raised'
    if result['outcome'] != 'arrived':
        return 'failed'
    off = result['position_error_m'] > WRONG_M or abs(result['heading_error_deg']) > WRONG_DEG
    return 'wrong' if off else 'arrived'


def _smoothness(log: RunLog) -> dict[str, Any]:
    """Return what whoever watches the run sees of it: time over the least, standstills, jerk."""
    times, samples = seconds(log), log.samples
    least = None if log.limits is None else least_time(samples[0].pose, log.limits)
    return {
        'least_time_s': least,
        'time_ratio': end_s(log) / least if least else None,
        'standstills': standstills(log),
        'standing_s': standing_s(log),
        'reversals': reversals(log),
        'phase_changes': len(phase_spans(log)) - 1,
        'peak_jerk_m_s3': _peak_jerk(times, [sample.twist.linear for sample in samples]),
        'peak_jerk_rad_s3': _peak_jerk(times, [sample.twist.angular for sample in samples]),
    }


def standstills(log: RunLog) -> int:
    """Return how often the robot stood on its way, turns in place and holds included."""
    times, final = seconds(log), log.samples[-1].pose

    def stands(index: int) -> bool:
        sample = log.samples[index]
        away = math.hypot(sample.pose.x - final.x, sample.pose.y - final.y) > 0.5 * AT_GOAL_M
        return away and sample.phase.runs and abs(sample.twist.linear) < LEAST_REVERSED['v']

    spans = [list(span) for stood, span in groupby(range(len(times)), stands) if stood]
    return sum(times[span[-1]] - times[span[0]] >= LEAST_STANDSTILL_S for span in spans)


def standing_s(log: RunLog) -> float:
    """Return the longest time that a robot within AT_GOAL_M of the goal did not end [s]."""
    times, longest, since = seconds(log), 0.0, None
    for time, sample in zip(times, log.samples, strict=True):
        if since is not None:
            longest = max(longest, time - since)
        if not (sample.phase.runs and sample.pose.distance <= AT_GOAL_M):
            since = None
        elif since is None:
            since = time
    return longest


def reversals(log: RunLog) -> dict[str, int]:
    """Return how often commands of at least LEAST_REVERSED changed sign: v and w."""
    counts = {}
    for name, speeds in (
        ('v', [sample.twist.linear for sample in log.samples]),
        ('w', [sample.twist.angular for sample in log.samples]),
    ):
        signs = [speed > 0.0 for speed in speeds if abs(speed) > LEAST_REVERSED[name]]
        counts[name] = sum(one != other for one, other in pairwise(signs))
    return counts


def _peak_jerk(times: Sequence[float], speeds: Sequence[float]) -> float:
    """Return the largest jerk of commanded ``speeds`` [m/s^3 or rad/s^3]."""
    commands = zip(times, speeds, strict=True)
    rates = [(t1, (v1 - v0) / (t1 - t0)) for (t0, v0), (t1, v1) in pairwise(commands) if t1 > t0]
    return max(
        (abs(b - a) / (later - now) for (now, a), (later, b) in pairwise(rates)), default=0.0
    )
