"""Faults of what is seen: a deep scene, compressed images, light that goes, a window."""

from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Header

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.evaluation.faults.catalogue.calibration import DESIRED, taken
from visual_servo_epipolar.evaluation.faults.catalogue.clocks import world_change
from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    at_first,
    Fault,
    Faults,
    StruckRun,
)
from visual_servo_epipolar.evaluation.faults.catalogue.streams import IMAGES
from visual_servo_epipolar.evaluation.live.wire import Envelope, HOP_NS
from visual_servo_epipolar.evaluation.live.world import WorldSettings

TRUTH = '/ground_truth'
FARTHER = 4.0  # than else, where the scene is deep
QUALITY = 80  # of JPEGs
CAMERA = 'camera_node'
OFF_S = 2.0  # how long it is dark
LEAPS, LEAP = 8, (0.3, 2.0)  # of the exposure, and how long each lasts [s]
PASSING = {'disturbed_from': 0, 'disturbed_for': 10**6}  # always


def _deep(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    x, y, heading = settings.start
    start = FARTHER * x, FARTHER * y, heading
    return replace(settings, start=start, depth=float(rng.uniform(15.0, 25.0)))


def _look_far(scene: StruckRun) -> None:
    """Let the scene be deeper, 60 to 200 m: the camera is moved by so much less."""
    depth = scene.world.settings.depth
    scene.notes.append(f'{depth:.0f} times as deep')

    def look(message: Any) -> None:
        position = message.pose.pose.position
        position.x, position.y = position.x / depth, position.y / depth

    scene.alter(TRUTH, look)


def _jpeg_damaged(scene: StruckRun) -> None:
    """Send JPEGs, some damaged in the middle for a while: they decode all the same."""
    begin_s, share = scene.witness.now_s + scene.draw(1.0, 6.0), scene.draw(0.3, 1.0)
    end_s = begin_s + scene.draw(0.5, 8.0)
    scene.notes.append(f'{share:.0%} of them, for {end_s - begin_s:.1f} s')
    scene.later(end_s - scene.witness.now_s, lambda: None)

    def compress(envelope: Envelope) -> list[Envelope]:
        image = envelope.message
        jpeg = _jpeg(np.frombuffer(image.data, np.uint8).reshape(image.height, image.width))
        if begin_s <= scene.witness.now_s < end_s and scene.hits(share):
            first = int(len(jpeg) * scene.draw(0.3, 0.7))
            jpeg[first : first + len(jpeg) // 10] = scene.rng.integers(0, 255)
        message = _compressed_image(image.header, jpeg)
        return [envelope.changed(topic=f'{IMAGES}/compressed', message=message)]

    message = _compressed_image(Header(), _jpeg(taken(scene.world.settings.camera, DESIRED_POSE)))
    scene.world.wire.send(Envelope(f'{DESIRED}/compressed', message, HOP_NS))
    scene.filter(IMAGES, compress)


def _jpeg(pixels: Pixels) -> Pixels:
    jpeg = cv2.imencode('.jpg', pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1]
    return np.array(jpeg, np.uint8).ravel()


def _compressed_image(header: Header, jpeg: Pixels) -> CompressedImage:
    message = CompressedImage(header=header, format='mono8; jpeg compressed mono8')
    message.data.frombytes(jpeg.tobytes())
    return message


def _set(scene: StruckRun, after_s: float = 0.0, **values: Any) -> None:
    """Set parameters of the camera in ``after_s`` from now."""
    scene.later(after_s, lambda: scene.world.set(CAMERA, values))


def _off_and_on(scene: StruckRun) -> None:
    """Switch the light off, and on again: one lamp far behind is left."""
    _set(scene, light='dark')
    _set(scene, OFF_S, light='ceiling')


def _open_window(scene: StruckRun) -> None:
    seconds = scene.spell(0.5, 10.0)
    _set(scene, light='window')
    if np.isfinite(seconds):
        _set(scene, seconds, light='ceiling')


def _leap(scene: StruckRun) -> None:
    """Let the exposure leap by a factor of two, again and again, up and down."""
    after_s = 0.0
    for factor in [*scene.rng.choice([0.5, 1.0, 2.0], LEAPS), 1.0]:
        _set(scene, after_s, passing_exposure=float(factor), **PASSING)
        after_s += scene.draw(*LEAP)


FOLLOWING = world_change(more={CAMERA: {'exposure': 'auto'}})
COMPRESSING = world_change(more={'tracker_node': {'transport': 'compressed'}})
FAULTS: Faults = {
    'scene_deep': at_first('a scene 60 to 200 m deep', _look_far, _deep),
    'jpeg_damaged': at_first('JPEGs damaged in the middle', _jpeg_damaged, COMPRESSING),
    'light_off': Fault('light off for 2 s', _off_and_on),
    'light_off_auto': Fault(
        'the light goes off, and on after 2 s; the exposure follows',
        _off_and_on,
        FOLLOWING,
    ),
    'window_opened': Fault(
        'a window opens in view, and the exposure follows', _open_window, FOLLOWING
    ),
    'exposure_leaps': Fault('the exposure leaps by a factor of two', _leap),
}
