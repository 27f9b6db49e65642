"""What tracker and servo take for the same images in memory: no message, no wire, no process."""

from collections.abc import Sequence
from time import perf_counter, sleep

import numpy as np

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.geometry.cameras.model import CameraModel
from visual_servo_epipolar.core.perception.observation import observe
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.step import decided, learnt
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker

WARM_UP = 10  # images that are not counted: the photograph is found, memory is claimed


def in_memory(
    photograph: Image,
    images: Sequence[Image],
    camera: CameraModel,
    rate: float,
    *,
    paced: bool = False,
) -> dict[str, float]:
    """
    Return the medians [ms] of tracker and servo: ``tracker_ms``, ``servo_ms``.

    What a twist waits for; what prepares for the next image after that is not counted. If
    ``paced``, images come at their rate, and not one upon the other: a processor that has slept
    in between finds little in its caches, as in the nodes.

    Parameters
    ----------
    photograph : array, shape (H, W)
        The desired view.
    images : sequence of arrays, shape (H, W)
        What the camera shows, one after the other.
    camera : CameraModel
        Whose images they are.
    rate : float
        Images a second [Hz], of their stamps.

    """
    tracker, settings, state = Tracker(TrackerSettings()), ServoSettings(), ServoState()
    tracker.set_desired(photograph)
    times = []
    first = perf_counter()
    for number, image in enumerate(images):
        if paced:
            sleep(max(first + number / rate - perf_counter(), 0.0))
        began = perf_counter()
        features = tracker.track(image)
        tracked = perf_counter()
        observation = observe(features, camera, round(number * NANOSECONDS / rate))
        state = decided(state, observation, settings)
        times.append((tracked - began, perf_counter() - tracked))
        state = learnt(state)  # the twist does not wait for it
        tracker.prepare()
    tracker_ms, servo_ms = 1e3 * np.median(times[WARM_UP:], axis=0)
    return {'tracker_ms': float(tracker_ms), 'servo_ms': float(servo_ms)}
