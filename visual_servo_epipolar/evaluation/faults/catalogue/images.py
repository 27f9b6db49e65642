"""Faults of images: what they show is not there, or nothing; deep scenes, JPEGs, light."""

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Header

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.evaluation.faults.catalogue.calibration import (
    DESIRED,
    photograph,
    taken,
)
from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    always,
    at_first,
    Fault,
    Faults,
    striking,
    StruckRun,
    world_change,
)
from visual_servo_epipolar.evaluation.faults.catalogue.streams import IMAGES, LONGEST_S, untrue
from visual_servo_epipolar.evaluation.live.wire import Envelope, HOP_NS
from visual_servo_epipolar.evaluation.live.world import WorldSettings

KEPT = 40  # images that another may be swapped for
BLOB = 0.45  # of the image's height and width, what covers part of it
Change = Callable[[Pixels, StruckRun], Any]


def _pixels(message: Any) -> Pixels:
    return np.frombuffer(message.data, np.uint8).reshape(message.height, message.width)


def _showing(message: Any, data: bytes) -> Any:
    """Return an image message like ``message``, of other pixels."""
    copy = type(message)(header=message.header, encoding=message.encoding)
    copy.height, copy.width, copy.step = message.height, message.width, message.step
    copy.data.frombytes(data)
    return copy


def _changed(envelope: Envelope, change: Change, scene: StruckRun) -> Envelope:
    """Return ``envelope`` with the pixels that ``change`` makes of those in it."""
    pixels = np.ascontiguousarray(change(_pixels(envelope.message), scene), np.uint8)
    return replace(envelope, message=_showing(envelope.message, pixels.tobytes()))


def _again(envelope: Envelope, old: Envelope, *, stamps: bool = False) -> list[Envelope]:
    """Return an ``old`` image in place of this one, with a stamp of its own or of this one."""
    message = _showing(old.message, old.message.data.tobytes())
    if stamps:
        message.header = envelope.message.header
    return [replace(envelope, message=message, sight=old.sight)]


@striking
def _frozen(scene: StruckRun, *, stamps: bool) -> None:
    """Let a camera hang: it repeats an image, with stamps that go on or not."""
    kept: list[Envelope] = []

    def freeze(envelope: Envelope) -> list[Envelope]:
        if not kept:
            kept.append(envelope)
        return _again(envelope, kept[0], stamps=stamps)

    scene.filter(IMAGES, freeze, scene.spell(0.5, LONGEST_S))


def _swap(scene: StruckRun) -> None:
    kept: deque[Envelope] = deque(maxlen=KEPT)

    def swap(envelope: Envelope) -> list[Envelope]:
        kept.append(envelope)
        return _again(envelope, kept[int(scene.rng.integers(len(kept)))], stamps=True)

    scene.filter(IMAGES, swap, scene.spell(0.5, LONGEST_S))


def _loop(scene: StruckRun) -> None:
    """Play the images of the next seconds again and again, as a bag in a loop: old stamps, too."""
    length = int(scene.rng.integers(10, 60))
    bag: list[Envelope] = []
    scene.notes.append(f'{length} images long')
    played = 0

    def play(envelope: Envelope) -> list[Envelope]:
        nonlocal played
        if len(bag) < length:
            bag.append(envelope)
            return [envelope]
        played += 1
        return _again(envelope, bag[(played - 1) % length])

    scene.filter(IMAGES, play)


@striking
def _seen(scene: StruckRun, change: Change) -> None:
    """Let other pixels stand for those that were taken."""
    seconds = scene.spell(0.3, LONGEST_S)
    scene.filter(IMAGES, lambda it: [untrue(_changed(it, change, scene))], seconds)


def _shown(scene: StruckRun, change: Change, seconds: float = np.inf) -> None:
    """Let images show what is there in another way."""
    scene.filter(IMAGES, lambda envelope: [_changed(envelope, change, scene)], seconds)


@striking
def _remount(scene: StruckRun, change: Change) -> None:
    """Change all images of a camera, the photograph as well."""

    def taken_so(scene: StruckRun) -> Pixels:
        image = taken(scene.world.settings.camera, DESIRED_POSE)
        return np.ascontiguousarray(change(image, scene), np.uint8)

    _shown(scene, change)
    photograph(taken_so)(scene)


def _mirror(image: Pixels, scene: StruckRun) -> Any:
    return image[:, ::-1]


def _upside_down(image: Pixels, scene: StruckRun) -> Any:
    return image[::-1, ::-1]


def _cover(scene: StruckRun) -> None:
    """Cover part of the images with what moves along: what is left is true."""
    place, shade = scene.rng.random(2), scene.rng.integers(0, 256)

    def cover(image: Pixels, scene: StruckRun) -> Pixels:
        covered = image.copy()
        size = (BLOB * np.array(image.shape)).astype(int)
        top, left = (place * (np.array(image.shape) - size)).astype(int)
        covered[top : top + size[0], left : left + size[1]] = shade
        return covered

    _shown(scene, cover, scene.spell(0.3, LONGEST_S))


@striking
def _damage(scene: StruckRun, change: Callable[[Any, StruckRun], None]) -> None:
    """Let images contradict their own head."""

    def damage(envelope: Envelope) -> list[Envelope]:
        change(envelope.message, scene)
        return [untrue(envelope)]

    scene.filter(IMAGES, damage, scene.spell(0.3, LONGEST_S))


def _lying_size(message: Any, scene: StruckRun) -> None:
    message.height = int(scene.rng.integers(0, 4096))


def _truncate(message: Any, scene: StruckRun) -> None:
    del message.data[int(scene.rng.integers(0, len(message.data))) :]


def _unknown_encoding(message: Any, scene: StruckRun) -> None:
    message.encoding = 'mono7'


BLACK = _seen(lambda image, scene: np.zeros_like(image))
WHITE = _seen(lambda image, scene: np.full_like(image, 255))
NOISE = _seen(lambda image, scene: scene.rng.integers(0, 256, image.shape))
SHOWN: Faults = {
    'images_frozen': Fault('the same image again and again, stamps go on', _frozen(stamps=True)),
    'camera_hangs': Fault('the same image again and again, stamp and all', _frozen(stamps=False)),
    'images_swapped': Fault('images of other times of the run', _swap),
    'bag_loop': Fault('images of a bag in a loop, with its stamps', _loop),
    'images_black': always('black images', BLACK),
    'images_saturated': Fault('white images', WHITE),
    'images_garbage': always('noise for images', NOISE),
    'images_mirrored': Fault('mirrored images', _seen(_mirror)),
    'images_upside_down': Fault('images upside down', _seen(_upside_down)),
    'camera_mirrored': at_first('a driver that mirrors all images', _remount(_mirror)),
    'camera_upside_down': at_first('a camera mounted upside down', _remount(_upside_down)),
    'images_covered': Fault('a fifth of the image is covered', _cover),
    'images_lying_size': Fault('images of a height that lies', _damage(_lying_size)),
    'images_truncated': Fault('images without their end', _damage(_truncate)),
    'images_unknown_encoding': Fault('images in an unknown encoding', _damage(_unknown_encoding)),
}

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
        jpeg = _jpeg(_pixels(envelope.message))
        if begin_s <= scene.witness.now_s < end_s and scene.hits(share):
            first = int(len(jpeg) * scene.draw(0.3, 0.7))
            jpeg[first : first + len(jpeg) // 10] = scene.rng.integers(0, 255)
        message = _compressed_image(envelope.message.header, jpeg)
        return [replace(envelope, topic=f'{IMAGES}/compressed', message=message)]

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
SCENES: Faults = {
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
