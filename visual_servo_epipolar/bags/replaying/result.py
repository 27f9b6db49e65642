"""
Result of a replay as a run log and as the JSON of a run.

A run ends where its last phase began, arrived or failed: a recording may go on for long.
"""

from collections.abc import Sequence
import math
from typing import Any

from visual_servo_epipolar.bags.reading.run import Recording
from visual_servo_epipolar.bags.replaying.replay import ReplayedStep
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.run_log import MotionLimits, RunLog, SETTLE_FRAMES, summarise
from visual_servo_epipolar.core.servo.telemetry import sample

FROM_TRUTH = (
    'start',
    'position_error_m',
    'lateral_error_m',
    'longitudinal_error_m',
    'heading_error_deg',
    'path_length_m',
    'max_distance_ratio',
    'standstills',
    'standing_s',
    'least_time_s',
    'time_ratio',
)


def has_truth(run: Recording, steps: Sequence[ReplayedStep]) -> bool:
    """Return whether ground truth was recorded for every step."""
    return all(step.key[0] in run.poses for step in steps)


def driven(steps: Sequence[ReplayedStep]) -> Sequence[ReplayedStep]:
    """Return the steps to the end of the run, with some more in which the base brakes."""
    phase, count = steps[-1].phase, len(steps)
    if not phase.ended:
        return steps
    while count and steps[count - 1].phase is phase:
        count -= 1
    return steps[: count + SETTLE_FRAMES]


def run_log(
    run: Recording,
    steps: Sequence[ReplayedStep],
    *,
    seed: int,
    law: str,
    limits: MotionLimits | None = None,
) -> RunLog:
    """Return the replay up to its end as a record; without ground truth poses are the goal's."""
    steps = driven(steps)
    poses = [run.poses.get(step.key[0], DESIRED_POSE) for step in steps]
    samples = tuple(
        sample(step.key[0], pose, step.phase, step.telemetry)
        for step, pose in zip(steps, poses, strict=True)
    )
    last = steps[-1]
    reason = last.reason
    if not last.phase.ended:
        reason = f'the bag ends in {last.phase.value}' + (f': {reason}' if reason else '')
    return RunLog(
        # As users give it, without the rounding of a quaternion.
        (poses[0].x, poses[0].y, round(math.degrees(poses[0].heading_error), 9) + 0.0),
        seed,
        samples,
        'arrived' if last.phase is Phase.ARRIVED else 'failed',
        reason,
        int(last.telemetry['attempt']),
        law,
        limits,
    )


def document(log: RunLog, *, truth: bool) -> dict[str, Any]:
    """Return the run JSON; what only ground truth could tell is null where there is none."""
    result = summarise(log)
    return result if truth else {**result, **dict.fromkeys(FROM_TRUTH)}
