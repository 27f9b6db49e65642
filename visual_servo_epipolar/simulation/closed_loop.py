"""One run in memory: world, tracker and servo in one loop, without ROS and without a clock."""

from collections.abc import Callable
from dataclasses import dataclass, field
import math
from typing import Protocol

from visual_servo_epipolar.core.camera import Camera
from visual_servo_epipolar.core.features import Features
from visual_servo_epipolar.core.motion import Pose, quaternion_from_yaw, yaw_from_quaternion
from visual_servo_epipolar.core.perception import observe
from visual_servo_epipolar.core.phases import Phase
from visual_servo_epipolar.core.run_log import RunLog, Sample
from visual_servo_epipolar.core.servo import step
from visual_servo_epipolar.core.servo_settings import ServoSettings
from visual_servo_epipolar.core.servo_state import ServoState
from visual_servo_epipolar.simulation.pioneer import BaseSettings, Pioneer

NANOSECONDS = 1_000_000_000
SETTLE_FRAMES = 6  # the base may still be braking when the servo says that it has arrived


class View(Protocol):
    """What stands between the world and the servo: points, or images and a tracker."""

    def observe(self, pose: Pose, frame: int) -> Features:
        """Return the features seen from ``pose`` in frame number ``frame``."""
        ...


@dataclass(frozen=True, kw_only=True)
class LoopSettings:
    """One run: where it starts, how it is seeded, how long it may take."""

    start: tuple[float, float, float]
    seed: int = 0
    frame_rate: float = 11.0
    max_duration: float = 300.0
    servo: ServoSettings = field(default_factory=ServoSettings)
    base: BaseSettings = field(default_factory=BaseSettings)


def period_ns(frame_rate: float) -> int:
    """Return the time between two frames [ns]: whole, so that stamps add up exactly."""
    return round(NANOSECONDS / frame_rate)


def published(pose: Pose) -> Pose:
    """Return ``pose`` as it arrives through a message, where the heading is a quaternion."""
    return Pose(pose.x, pose.y, yaw_from_quaternion(*quaternion_from_yaw(pose.theta)))


def run(
    settings: LoopSettings,
    view: View,
    camera: Camera,
    *,
    watch: Callable[[Sample], None] | None = None,
) -> RunLog:
    """
    Drive from the start until the servo ends, and return the record.

    ``watch`` is called after each step. The order of events is that of the nodes in lockstep:
    ground truth, image, tracks, command, and only then does the base move for one period.
    """
    base = Pioneer(settings.base, Pose.from_start(*settings.start), seed=settings.seed)
    state = ServoState()
    samples: list[Sample] = []
    step_ns, braking = period_ns(settings.frame_rate), 0
    while braking < SETTLE_FRAMES and base.now_ns < settings.max_duration * NANOSECONDS:
        pose = published(base.pose)
        features = view.observe(pose, len(samples))
        state = step(state, observe(features, camera, base.now_ns), settings.servo)
        samples.append(sample(pose, state, camera))
        if watch is not None:
            watch(samples[-1])
        braking = braking + 1 if state.ended else 0
        base.command(state.twist)
        base.advance(base.now_ns + step_ns)
    return record(settings, samples, state)


def sample(pose: Pose, state: ServoState, camera: Camera) -> Sample:
    """Return the record of one step."""
    sight = state.sight
    if sight is None:
        raise ValueError('a sample needs a servo that has seen something; step it first')
    bearings = sight.bearings
    return Sample(
        stamp_ns=sight.stamp_ns,
        pose=pose,
        twist=state.twist,
        phase=state.phase,
        features=sight.features,
        epipole_current=camera.fx * bearings.epipole_current if bearings else math.nan,
        epipole_desired=camera.fx * bearings.epipole_desired if bearings else math.nan,
        bearing_current=bearings.current if bearings else math.nan,
        bearing_desired=bearings.desired if bearings else math.nan,
        feature_difference=sight.difference * sight.focal**2,
        feature_error=sight.feature_error * sight.focal,
        distance_estimate=state.distance,
    )


def record(settings: LoopSettings, samples: list[Sample], state: ServoState) -> RunLog:
    """Return the run as ended by ``state``; a run cut off by its duration has failed."""
    if state.ended:
        outcome = 'arrived' if state.phase is Phase.ARRIVED else 'failed'
        reason = state.reason
    else:
        outcome, limit = 'failed', settings.max_duration
        reason = f'not arrived within {limit:g} s, still {state.phase.value}: {state.reason}'
    return RunLog(
        settings.start,
        settings.seed,
        tuple(samples),
        outcome,
        reason.rstrip(': '),
        state.attempts,
        settings.servo.law,
    )
