"""What tracker and servo take for the same images in memory: no message, no wire, no process."""

from collections.abc import Iterator
from time import perf_counter, sleep

import numpy as np

from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.perception.observation import observe
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.step import decided, learnt
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.evaluation.benchmarks.wire.driven_run import DrivenRun


def in_memory(run: DrivenRun, *, paced: bool = False) -> dict[str, float]:
    """
    Return the medians [ms] of tracker and servo: ``tracker_ms``, ``servo_ms``.

    What a twist waits for; what prepares for the next image after that is not counted. If
    ``paced``, images come at their rate, and not one upon the other: a processor that has slept
    in between finds little in its caches, as in the nodes.
    """
    medians = 1e3 * np.median([times for times, _ in steps(run, paced=paced)], axis=0)
    return dict(zip(('tracker_ms', 'servo_ms'), map(float, medians), strict=True))


def steps(run: DrivenRun, *, paced: bool = False) -> Iterator[tuple[tuple[float, float], Twist]]:
    """Yield, for each image of the run, the times of tracker and servo [s], and the twist."""
    tracker, settings, state = Tracker(TrackerSettings()), ServoSettings(), ServoState()
    tracker.set_desired(run.photograph)
    for image in run.lead:
        tracker.track(image)
    first = perf_counter()
    for number, image in enumerate(run.images):
        if paced:
            sleep(max(first + number / run.rate - perf_counter(), 0.0))
        began = perf_counter()
        features = tracker.track(image)
        tracked = perf_counter()
        observation = observe(features, run.camera, run.stamp_ns(number))
        state = decided(state, observation, settings)
        yield (tracked - began, perf_counter() - tracked), state.twist
        state = learnt(state)  # the twist does not wait for it
        tracker.prepare()
