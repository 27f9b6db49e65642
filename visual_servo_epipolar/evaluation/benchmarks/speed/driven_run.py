"""Images of a run that the servo has driven itself: its nodes decide by them as it did."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import math
from pathlib import Path
from time import perf_counter, sleep

import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.perception.observation import observe
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.step import decide, update_map
from visual_servo_epipolar.core.stamps import period_ns
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.evaluation.live.chain import START
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator, ImageView
from visual_servo_epipolar.simulation.closed_loop import run
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.run_monitor import LoopSettings

LEAD = 10  # images at rest before the run, in which the tracker finds the photograph
SAME_LINEAR, SAME_ANGULAR = 1e-3, math.radians(0.5)  # to which two twists are the same [SI]


@dataclass(frozen=True, slots=True, eq=False)
class DrivenRun:
    """
    Run that the servo has driven: what the robot saw, and what it was told.

    ``images``, N arrays of shape (H, W) at ``rate`` [Hz], come one after the other from the start,
    none after the end of the run; ``twists`` are the N answers.
    """

    camera: CameraModel
    rate: float
    photograph: Image
    images: Sequence[Image]
    twists: Sequence[Twist]

    @property
    def lead(self) -> list[Image]:
        """Images before the run: the first, again and again."""
        return [self.images[0]] * LEAD

    def stamp_ns(self, number: int) -> int:
        """Return the time of an image since the first [ns]."""
        return number * period_ns(self.rate)


def driven(settings: CameraSettings, seconds: float, folder: Path) -> DrivenRun:
    """
    Drive from START for ``seconds`` [s], or to the end of the run before that.

    Images are in a file of ``folder``, which has to stay: 20 s of 1280x1024 at 30 Hz are 0.8 GB.
    """
    simulator, rate = CameraSimulator(settings), settings.frame_rate
    view = ImageView(simulator, Tracker(TrackerSettings()))
    for image in [simulator.capture(Pose.from_start(*START), 0)] * LEAD:
        view.tracker.track(image)
    shape = round(seconds * rate), settings.height, settings.width
    images = np.memmap(folder / 'images', np.uint8, 'w+', shape=shape)
    twists: list[Twist] = []

    def keep(sample: Sample) -> None:
        if not sample.phase.ended and len(twists) < len(images):
            images[len(twists)] = view.image
            twists.append(sample.twist)

    loop = LoopSettings(start=START, seed=settings.seed, frame_rate=rate, max_duration=seconds)
    run(loop, view, simulator.camera, watch=keep)
    images.flush()  # nobody is to write while latencies are measured
    seen = tuple(np.asarray(images)[: len(twists)])
    return DrivenRun(simulator.camera, rate, view.desired, seen, twists)


def are_same(one: Twist, other: Twist) -> bool:
    """Return whether two twists are the same, but for what stamps and rounding make of them."""
    linear, angular = abs(one.linear - other.linear), abs(one.angular - other.angular)
    return linear <= SAME_LINEAR and angular <= SAME_ANGULAR


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
        state = decide(state, observation, settings)
        yield (tracked - began, perf_counter() - tracked), state.twist
        state = update_map(state)  # the twist does not wait for it
        tracker.prepare()
