"""Faults of what images show: what is not there, or nothing."""

from collections import deque
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE
from visual_servo_epipolar.evaluation.faults.catalogue.calibration import photograph, taken
from visual_servo_epipolar.evaluation.faults.catalogue.fault import ALWAYS, AT_FIRST, Fault, Scene
from visual_servo_epipolar.evaluation.faults.catalogue.streams import IMAGES
from visual_servo_epipolar.evaluation.live.wire import Envelope

LONGEST_S = 10.0
KEPT = 40  # images that another may be swapped for
BLOB = 0.45  # of the image's height and width, what covers part of it


def untrue(envelope: Envelope, message: Any) -> Envelope:
    """Return ``envelope`` with a message that does not show what was there."""
    return envelope.changed(message=message, sight=envelope.sight and envelope.sight.lie())


def showing(message: Any, data: bytes) -> Any:
    """Return an image message like ``message``, of other pixels."""
    copy = type(message)(header=message.header, encoding=message.encoding)
    copy.height, copy.width, copy.step = message.height, message.width, message.step
    copy.data.frombytes(data)
    return copy


def _frozen(*, stamps: bool) -> Callable[[Scene], None]:
    """Return a camera that hangs: it repeats an image, with stamps that go on or not."""

    def strike(scene: Scene) -> None:
        kept: list[Envelope] = []

        def freeze(envelope: Envelope) -> list[Envelope]:
            if not kept:
                kept.append(envelope)
            message = showing(kept[0].message, kept[0].message.data.tobytes())
            if stamps:
                message.header = envelope.message.header
            return [envelope.changed(message=message, sight=kept[0].sight)]

        scene.filter(IMAGES, freeze, scene.spell(0.5, LONGEST_S))

    return strike


def _swapped(scene: Scene) -> None:
    kept: deque[Envelope] = deque(maxlen=KEPT)

    def swap(envelope: Envelope) -> list[Envelope]:
        kept.append(envelope)
        other = kept[int(scene.rng.integers(len(kept)))]
        message = showing(envelope.message, other.message.data.tobytes())
        return [envelope.changed(message=message, sight=other.sight)]

    scene.filter(IMAGES, swap, scene.spell(0.5, LONGEST_S))


def _loop(scene: Scene) -> None:
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
        old = bag[played % length]
        played += 1
        message = showing(old.message, old.message.data.tobytes())
        return [envelope.changed(message=message, sight=old.sight)]

    scene.filter(IMAGES, play)


def _seen(pixels: Callable[[Pixels, Scene], Any]) -> Callable[[Scene], None]:
    """Return images in which ``pixels`` stand for those that were taken."""

    def strike(scene: Scene) -> None:
        def show(envelope: Envelope) -> list[Envelope]:
            message = envelope.message
            image = np.frombuffer(message.data, np.uint8).reshape(message.height, message.width)
            shown = _contiguous(pixels(image, scene))
            return [untrue(envelope, showing(message, shown.tobytes()))]

        scene.filter(IMAGES, show, scene.spell(0.3, LONGEST_S))

    return strike


def _black(image: Pixels, scene: Scene) -> Any:
    return np.zeros_like(image)


def _saturated(image: Pixels, scene: Scene) -> Any:
    return np.full_like(image, 255)


def _garbage(image: Pixels, scene: Scene) -> Any:
    return scene.rng.integers(0, 256, image.shape)


def _mirrored(image: Pixels, scene: Scene) -> Any:
    return image[:, ::-1]


def _upside_down(image: Pixels, scene: Scene) -> Any:
    return image[::-1, ::-1]


def _mounted(pixels: Callable[[Pixels, Scene], Any]) -> Callable[[Scene], None]:
    """Return a camera whose images are all as ``pixels`` has them, the photograph as well."""

    def taken_so(scene: Scene) -> Pixels:
        return _contiguous(pixels(taken(scene.world.settings.camera, DESIRED_POSE), scene))

    def strike(scene: Scene) -> None:
        def show(envelope: Envelope) -> list[Envelope]:
            message = envelope.message
            image = np.frombuffer(message.data, np.uint8).reshape(message.height, message.width)
            shown = _contiguous(pixels(image, scene))
            return [envelope.changed(message=showing(message, shown.tobytes()))]

        scene.filter(IMAGES, show)
        photograph(taken_so)(scene)

    return strike


def _contiguous(pixels: Any) -> Pixels:
    return np.ascontiguousarray(pixels, np.uint8)


def _covered(scene: Scene) -> None:
    """Cover part of the images with what moves along: what is left is true."""
    place, shade = scene.rng.random(2), scene.rng.integers(0, 256)

    def cover(envelope: Envelope) -> list[Envelope]:
        message = envelope.message
        image = np.frombuffer(message.data, np.uint8).reshape(message.height, message.width).copy()
        size = (BLOB * np.array(image.shape)).astype(int)
        top, left = (place * (np.array(image.shape) - size)).astype(int)
        image[top : top + size[0], left : left + size[1]] = shade
        return [envelope.changed(message=showing(message, image.tobytes()))]

    scene.filter(IMAGES, cover, scene.spell(0.3, LONGEST_S))


def _damaged(change: Callable[[Any, Scene], None]) -> Callable[[Scene], None]:
    """Return images that contradict their own head."""

    def strike(scene: Scene) -> None:
        def damage(envelope: Envelope) -> list[Envelope]:
            change(envelope.message, scene)
            return [untrue(envelope, envelope.message)]

        scene.filter(IMAGES, damage, scene.spell(0.3, LONGEST_S))

    return strike


def _lying_size(message: Any, scene: Scene) -> None:
    message.height = int(scene.rng.integers(0, 4096))


def _truncated(message: Any, scene: Scene) -> None:
    del message.data[int(scene.rng.integers(0, len(message.data))) :]


def _unknown_encoding(message: Any, scene: Scene) -> None:
    message.encoding = 'mono7'


FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        'images_frozen': Fault(
            what='the same image again and again, stamps go on', strike=_frozen(stamps=True)
        ),
        'camera_hangs': Fault(
            what='the same image again and again, stamp and all', strike=_frozen(stamps=False)
        ),
        'images_swapped': Fault(what='images of other times of the run', strike=_swapped),
        'bag_loop': Fault(what='images of a bag in a loop, with its stamps', strike=_loop),
        'images_black': Fault(what='black images', strike=_seen(_black), phases=ALWAYS),
        'images_saturated': Fault(what='white images', strike=_seen(_saturated)),
        'images_garbage': Fault(what='noise for images', strike=_seen(_garbage), phases=ALWAYS),
        'images_mirrored': Fault(what='mirrored images', strike=_seen(_mirrored)),
        'images_upside_down': Fault(what='images upside down', strike=_seen(_upside_down)),
        'camera_mirrored': Fault(
            what='a driver that mirrors all images', strike=_mounted(_mirrored), phases=AT_FIRST
        ),
        'camera_upside_down': Fault(
            what='a camera mounted upside down', strike=_mounted(_upside_down), phases=AT_FIRST
        ),
        'images_covered': Fault(what='a fifth of the image is covered', strike=_covered),
        'images_lying_size': Fault(
            what='images of a height that lies', strike=_damaged(_lying_size)
        ),
        'images_truncated': Fault(what='images without their end', strike=_damaged(_truncated)),
        'images_unknown_encoding': Fault(
            what='images in an unknown encoding', strike=_damaged(_unknown_encoding)
        ),
    }
)
