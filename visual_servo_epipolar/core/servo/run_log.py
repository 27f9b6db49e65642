"""The record of one run, and the verdict on it: what figures, files and sweeps are made from."""

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any

from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.servo.phases.table import Phase
from visual_servo_epipolar.core.stamps import NANOSECONDS


@dataclass(frozen=True, slots=True)
class Sample:
    """
    One control step: what was true, what was seen, what was commanded.

    ``pose`` is ground truth, known to the judge alone. Epipoles are abscissae in pixels from the
    principal point (nan where undefined), bearings of the other camera's centre in rad, right
    positive; ``feature_difference`` is D of eq. (23) in px^2, rotation compensated or not as the
    law has it.
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
    feature_error: float = math.nan  # median distance of current from desired features [px]
    distance_estimate: float = math.nan  # d_hat [m]


@dataclass(frozen=True, slots=True)
class RunLog:
    """A whole run: how it began, its samples in time order, how it ended."""

    start: tuple[float, float, float]  # x [m], y [m], heading error [deg]
    seed: int
    samples: Sequence[Sample]
    outcome: str  # 'arrived' or 'failed'
    reason: str
    attempts: int = 1
    law: str = 'full'


@dataclass(frozen=True, slots=True)
class PhaseSpan:
    """A stretch of time spent in one phase; times in seconds from the start of the run."""

    name: str
    start_s: float
    end_s: float


def seconds(log: RunLog) -> list[float]:
    """Return the time of each sample from the first [s]."""
    first = log.samples[0].stamp_ns
    return [(sample.stamp_ns - first) / NANOSECONDS for sample in log.samples]


def phase_spans(log: RunLog) -> list[PhaseSpan]:
    """Return the phases of a run one after the other."""
    times = seconds(log)
    spans: list[PhaseSpan] = []
    for time, sample in zip(times, log.samples, strict=True):
        if spans and spans[-1].name == sample.phase.value:
            continue
        if spans:
            spans[-1] = PhaseSpan(spans[-1].name, spans[-1].start_s, time)
        spans.append(PhaseSpan(sample.phase.value, time, times[-1]))
    return spans


def summarise(log: RunLog) -> dict[str, Any]:
    """Return the verdict on a run as the JSON document of the command line."""
    poses = [sample.pose for sample in log.samples]
    final, distance_0 = poses[-1], poses[0].distance
    seen = [s.features for s in log.samples if s.phase not in (Phase.WAITING, Phase.FAILED)]
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
        'path_length_m': sum(
            math.hypot(b.x - a.x, b.y - a.y) for a, b in zip(poses, poses[1:], strict=False)
        ),
        'max_distance_ratio': max(p.distance for p in poses) / distance_0 if distance_0 else None,
        'min_visible_features': min(seen, default=0),
        'max_linear_speed': max(abs(sample.twist.linear) for sample in log.samples),
        'max_angular_speed': max(abs(sample.twist.angular) for sample in log.samples),
        'phases': [
            {'name': span.name, 'start_s': span.start_s, 'end_s': span.end_s}
            for span in phase_spans(log)
        ],
        'attempts': log.attempts,
    }
