"""Faults of the stream of images: true ones that come late, unevenly, again, or not at all."""

from collections.abc import Callable
from typing import Any

from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    always,
    Fault,
    Faults,
    Strike,
    StruckRun,
)
from visual_servo_epipolar.evaluation.live.wire import Envelope

IMAGES = '/image_raw'


def delay(envelope: Envelope, seconds: float) -> Envelope:
    """Return ``envelope``, later by ``seconds``."""
    return envelope.changed(delay_ns=envelope.delay_ns + round(seconds * NANOSECONDS))


def drop_some(topic: str) -> Strike:
    """Lose up to half of the messages of ``topic``."""

    def strike(scene: StruckRun) -> None:
        share = scene.draw(0.1, 0.5)
        scene.notes.append(f'{share:.0%} of them')
        scene.filter(topic, lambda envelope: [] if scene.hits(share) else [envelope])

    return strike


def late(topic: str, low: float, high: float) -> Strike:
    """Delay the messages of ``topic``, each by the same time."""

    def strike(scene: StruckRun) -> None:
        seconds = scene.draw(low, high)
        scene.notes.append(f'by {seconds:.2f} s')
        scene.filter(topic, lambda envelope: [delay(envelope, seconds)])

    return strike


def _gap(scene: StruckRun) -> None:
    seconds = scene.draw(0.3, 8.0)
    scene.notes.append(f'for {seconds:.1f} s')
    scene.lose(IMAGES, seconds)


def _uneven(scene: StruckRun) -> None:
    scene.filter(IMAGES, lambda envelope: [delay(envelope, scene.draw(0.0, 0.5))])


def _out_of_order(scene: StruckRun) -> None:
    scene.filter(IMAGES, lambda envelope: [delay(envelope, 0.2 if scene.hits(0.3) else 0.0)])


def _repeat(scene: StruckRun) -> None:
    scene.filter(IMAGES, lambda envelope: [delay(envelope, 0.02 * k) for k in range(3)])


def _restamp(stamp: Callable[[int, StruckRun], int]) -> Strike:
    def strike(scene: StruckRun) -> None:
        def change(message: Any) -> None:
            time = message.header.stamp
            stamp_ns = stamp(int(time.sec) * NANOSECONDS + int(time.nanosec), scene)
            time.sec, time.nanosec = divmod(stamp_ns, NANOSECONDS)

        scene.alter(IMAGES, change)

    return strike


OF_1970 = _restamp(lambda stamp_ns, scene: stamp_ns % (1_000_000 * NANOSECONDS))
OF_ZERO = _restamp(lambda stamp_ns, scene: 0)
OF_TOMORROW = _restamp(lambda stamp_ns, scene: stamp_ns + 86_400 * NANOSECONDS)
OF_CHANCE = _restamp(lambda stamp_ns, scene: stamp_ns + round(scene.draw(-2.0, 2.0) * NANOSECONDS))
FAULTS: Faults = {
    'images_dropped': Fault('up to half of the images are lost', drop_some(IMAGES)),
    'images_gap': always('no images for 0.3 to 8 s', _gap),
    'images_end': always('no image any more', lambda scene: scene.lose(IMAGES)),
    'images_late': Fault('images 0.1 to 0.5 s late', late(IMAGES, 0.1, 0.5)),
    'images_very_late': Fault('images 1.5 to 4 s late', late(IMAGES, 1.5, 4.0)),
    'images_uneven': Fault('each image 0 to 0.5 s late', _uneven),
    'images_out_of_order': Fault('images overtake each other', _out_of_order),
    'images_repeated': Fault('each image comes three times', _repeat),
    'stamps_1970': Fault('stamps of 1970, in order', OF_1970),
    'stamps_zero': always('stamps of 0', OF_ZERO),
    'stamps_future': Fault('stamps of tomorrow', OF_TOMORROW),
    'stamps_random': Fault('stamps 2 s off, in any order', OF_CHANCE),
}
