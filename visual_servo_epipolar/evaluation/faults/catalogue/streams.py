"""Faults of the stream of images: true ones that come late, unevenly, again, or not at all."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.evaluation.faults.catalogue.fault import ALWAYS, Fault, Scene
from visual_servo_epipolar.evaluation.live.wire import Envelope

IMAGES = '/image_raw'
Stamp = Callable[[int, Scene], int]


def delayed(envelope: Envelope, seconds: float) -> Envelope:
    """Return ``envelope``, later by ``seconds``."""
    return envelope.changed(delay_ns=envelope.delay_ns + round(seconds * NANOSECONDS))


def dropped(topic: str) -> Callable[[Scene], None]:
    """Lose up to half of the messages of ``topic``."""

    def strike(scene: Scene) -> None:
        share = scene.draw(0.1, 0.5)
        scene.notes.append(f'{share:.0%} of them')
        scene.filter(topic, lambda envelope: [] if scene.hits(share) else [envelope])

    return strike


def gap(topic: str) -> Callable[[Scene], None]:
    """Lose all messages of ``topic`` for a while."""

    def strike(scene: Scene) -> None:
        seconds = scene.draw(0.3, 8.0)
        scene.notes.append(f'for {seconds:.1f} s')
        scene.filter(topic, lambda envelope: [], seconds)

    return strike


def late(topic: str, low: float, high: float) -> Callable[[Scene], None]:
    """Delay the messages of ``topic``, each by the same time."""

    def strike(scene: Scene) -> None:
        delay = scene.draw(low, high)
        scene.notes.append(f'by {delay:.2f} s')
        scene.filter(topic, lambda envelope: [delayed(envelope, delay)])

    return strike


def _end(scene: Scene) -> None:
    scene.filter(IMAGES, lambda envelope: [])


def _uneven(scene: Scene) -> None:
    scene.filter(IMAGES, lambda envelope: [delayed(envelope, scene.draw(0.0, 0.5))])


def _out_of_order(scene: Scene) -> None:
    scene.filter(IMAGES, lambda envelope: [delayed(envelope, 0.2 if scene.hits(0.3) else 0.0)])


def _repeated(scene: Scene) -> None:
    scene.filter(IMAGES, lambda envelope: [delayed(envelope, 0.02 * k) for k in range(3)])


def _stamped(stamp: Stamp) -> Callable[[Scene], None]:
    def strike(scene: Scene) -> None:
        def change(envelope: Envelope) -> list[Envelope]:
            time = envelope.message.header.stamp
            stamp_ns = stamp(int(time.sec) * NANOSECONDS + int(time.nanosec), scene)
            time.sec, time.nanosec = divmod(stamp_ns, NANOSECONDS)
            return [envelope]

        scene.filter(IMAGES, change)

    return strike


def _of_1970(stamp_ns: int, scene: Scene) -> int:
    return stamp_ns % (1_000_000 * NANOSECONDS)


def _of_zero(stamp_ns: int, scene: Scene) -> int:
    return 0


def _of_tomorrow(stamp_ns: int, scene: Scene) -> int:
    return stamp_ns + 86_400 * NANOSECONDS


def _of_chance(stamp_ns: int, scene: Scene) -> int:
    return stamp_ns + round(scene.draw(-2.0, 2.0) * NANOSECONDS)


FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        'images_dropped': Fault(what='up to half of the images are lost', strike=dropped(IMAGES)),
        'images_gap': Fault(what='no images for 0.3 to 8 s', strike=gap(IMAGES), phases=ALWAYS),
        'images_end': Fault(what='no image any more', strike=_end, phases=ALWAYS),
        'images_late': Fault(what='images 0.1 to 0.5 s late', strike=late(IMAGES, 0.1, 0.5)),
        'images_very_late': Fault(what='images 1.5 to 4 s late', strike=late(IMAGES, 1.5, 4.0)),
        'images_uneven': Fault(what='each image 0 to 0.5 s late', strike=_uneven),
        'images_out_of_order': Fault(what='images overtake each other', strike=_out_of_order),
        'images_repeated': Fault(what='each image comes three times', strike=_repeated),
        'stamps_1970': Fault(what='stamps of 1970, in order', strike=_stamped(_of_1970)),
        'stamps_zero': Fault(what='stamps of 0', strike=_stamped(_of_zero), phases=ALWAYS),
        'stamps_future': Fault(what='stamps of tomorrow', strike=_stamped(_of_tomorrow)),
        'stamps_random': Fault(what='stamps 2 s off, in any order', strike=_stamped(_of_chance)),
    }
)
