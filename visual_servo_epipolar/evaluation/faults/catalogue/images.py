"""Faults of what images show: what is not there, or nothing."""

from collections import deque
from collections.abc import Callable
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.evaluation.faults.catalogue.calibration import photograph, taken
from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    always,
    at_first,
    Fault,
    Faults,
    Strike,
    StruckRun,
)
from visual_servo_epipolar.evaluation.faults.catalogue.streams import IMAGES
from visual_servo_epipolar.evaluation.live.wire import Envelope

LONGEST_S = 10.0
KEPT = 40  # images that another may be swapped for
BLOB = 0.45  # of the image's height and width, what covers part of it
Change = Callable[[Pixels, StruckRun], Any]


def untrue(envelope: Envelope, message: Any) -> Envelope:
    """Return ``envelope`` with a message that does not show what was there."""
    return envelope.changed(message=message, sight=envelope.sight and envelope.sight.lie())


def showing(message: Any, data: bytes) -> Any:
    """Return an image message like ``message``, of other pixels."""
    copy = type(message)(header=message.header, encoding=message.encoding)
    copy.height, copy.width, copy.step = message.height, message.width, message.step
    copy.data.frombytes(data)
    return copy


def _replace_pixels(message: Any, change: Change, scene: StruckRun) -> Any:
    """Return an image message of the pixels that ``change`` makes of those in ``message``."""
    image = np.frombuffer(message.data, np.uint8).reshape(message.height, message.width)
    return showing(message, np.ascontiguousarray(change(image, scene), np.uint8).tobytes())


def _again(envelope: Envelope, old: Envelope, *, stamps: bool = False) -> list[Envelope]:
    """Return an ``old`` image in place of this one, with a stamp of its own or of this one."""
    message = showing(old.message, old.message.data.tobytes())
    if stamps:
        message.header = envelope.message.header
    return [envelope.changed(message=message, sight=old.sight)]


def _frozen(*, stamps: bool) -> Strike:
    """Return a camera that hangs: it repeats an image, with stamps that go on or not."""

    def strike(scene: StruckRun) -> None:
        kept: list[Envelope] = []

        def freeze(envelope: Envelope) -> list[Envelope]:
            if not kept:
                kept.append(envelope)
            return _again(envelope, kept[0], stamps=stamps)

        scene.filter(IMAGES, freeze, scene.spell(0.5, LONGEST_S))

    return strike


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


def _seen(change: Change) -> Strike:
    """Return images in which other pixels stand for those that were taken."""

    def strike(scene: StruckRun) -> None:
        def show(envelope: Envelope) -> list[Envelope]:
            return [untrue(envelope, _replace_pixels(envelope.message, change, scene))]

        scene.filter(IMAGES, show, scene.spell(0.3, LONGEST_S))

    return strike


def _shown(scene: StruckRun, change: Change, seconds: float = np.inf) -> None:
    """Let images show what is there in another way."""

    def show(envelope: Envelope) -> list[Envelope]:
        return [envelope.changed(message=_replace_pixels(envelope.message, change, scene))]

    scene.filter(IMAGES, show, seconds)


def _remount(change: Change) -> Strike:
    """Return a camera whose images are all changed, the photograph as well."""

    def taken_so(scene: StruckRun) -> Pixels:
        image = taken(scene.world.settings.camera, DESIRED_POSE)
        return np.ascontiguousarray(change(image, scene), np.uint8)

    def strike(scene: StruckRun) -> None:
        _shown(scene, change)
        photograph(taken_so)(scene)

    return strike


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


def _damage(change: Callable[[Any, StruckRun], None]) -> Strike:
    """Return images that contradict their own head."""

    def strike(scene: StruckRun) -> None:
        def damage(envelope: Envelope) -> list[Envelope]:
            change(envelope.message, scene)
            return [untrue(envelope, envelope.message)]

        scene.filter(IMAGES, damage, scene.spell(0.3, LONGEST_S))

    return strike


def _lying_size(message: Any, scene: StruckRun) -> None:
    message.height = int(scene.rng.integers(0, 4096))


def _truncate(message: Any, scene: StruckRun) -> None:
    del message.data[int(scene.rng.integers(0, len(message.data))) :]


def _unknown_encoding(message: Any, scene: StruckRun) -> None:
    message.encoding = 'mono7'


BLACK = _seen(lambda image, scene: np.zeros_like(image))
WHITE = _seen(lambda image, scene: np.full_like(image, 255))
NOISE = _seen(lambda image, scene: scene.rng.integers(0, 256, image.shape))
FAULTS: Faults = {
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
