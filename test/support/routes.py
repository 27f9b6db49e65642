"""Routes made by hand, for tests of what is done with them."""

import numpy as np

from visual_servo_epipolar.core.cameras.registry import calibrated_camera
from visual_servo_epipolar.core.routes.path import TaughtPath
from visual_servo_epipolar.core.routes.route import in_memory, Route, RouteView
from visual_servo_epipolar.core.routes.structure import LocalStructure
from visual_servo_epipolar.core.tracking.matchers.base import Keypoints

SIZE = (64, 48)
MATRIX = 50.0, 0.0, 31.5, 0.0, 50.0, 23.5, 0.0, 0.0, 1.0
CAMERA = calibrated_camera(SIZE, MATRIX, (), 'plumb_bob')


def key_view(number: int) -> RouteView:
    rng, count = np.random.default_rng(number), 12 + number
    pixels = rng.uniform(5.0, 40.0, (count, 2))
    descriptors = rng.integers(0, 200, (count, 128)).astype(np.float32)
    covariance = np.repeat(np.eye(3)[:, :, None], count, axis=2)
    way = number + np.arange(4.0)
    return RouteView(
        in_memory(rng.integers(0, 255, SIZE[::-1], np.uint8)),
        Keypoints(pixels, np.ones(count), np.zeros(count), descriptors, 2),
        LocalStructure(
            pixels,
            np.zeros((2, count)),
            rng.uniform(0.1, 1.0, count),
            covariance,
            np.zeros(5),
            0.01,
            0.1,
        ),
        TaughtPath(way, rng.standard_normal((4, 3)), np.zeros(4), np.full(4, 0.5)),
        float(number),
        np.array([float(number), 0.0, 0.1]),
        number == 2,
    )


def route_of(*views: RouteView) -> Route:
    return Route(CAMERA, views)
