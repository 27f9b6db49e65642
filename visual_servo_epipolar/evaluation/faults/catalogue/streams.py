"""Faults of streams: images and tracks that are late, unevenly, again, wrong, or not there."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    always,
    Fault,
    Faults,
    striking,
    StruckRun,
)
from visual_servo_epipolar.evaluation.live.wire import Envelope
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.messages.write import TRACK_LAYOUT

IMAGES, TRACKS = '/image_raw', '/tracks'
LONGEST_S = 10.0
Rows = Any


def delay(envelope: Envelope, seconds: float) -> Envelope:
    """Return ``envelope``, later by ``seconds``."""
    return replace(envelope, delay_ns=envelope.delay_ns + round(seconds * NANOSECONDS))


def untrue(envelope: Envelope) -> Envelope:
    """Return ``envelope`` as one that does not show what was there."""
    return replace(envelope, sight=envelope.sight and replace(envelope.sight, true=False))


def restamp(message: Any, stamp: Callable[[int], int]) -> None:
    """Let the stamp of a message be what ``stamp`` makes of it [ns]."""
    time = message.header.stamp
    time.sec, time.nanosec = divmod(stamp(read.stamp_ns(message.header)), NANOSECONDS)


@striking
def drop_some(scene: StruckRun, topic: str) -> None:
    """Lose up to half of the messages of ``topic``."""
    share = scene.draw(0.1, 0.5)
    scene.notes.append(f'{share:.0%} of them')
    scene.filter(topic, lambda envelope: [] if scene.hits(share) else [envelope])


@striking
def lost(scene: StruckRun, topic: str, low: float, high: float) -> None:
    """Lose all messages of ``topic``, for a while or for good."""
    scene.lose(topic, scene.spell(low, high))


@striking
def late(scene: StruckRun, topic: str, low: float, high: float) -> None:
    """Delay the messages of ``topic``, each by the same time."""
    seconds = scene.draw(low, high)
    scene.notes.append(f'by {seconds:.2f} s')
    scene.filter(topic, lambda envelope: [delay(envelope, seconds)])


def _gap(scene: StruckRun) -> None:
    seconds = scene.draw(0.3, 8.0)
    scene.notes.append(f'for {seconds:.1f} s')
    scene.lose(IMAGES, seconds)


@striking
def _copies(scene: StruckRun, delays: Callable[[StruckRun], list[float]]) -> None:
    """Let each image come as often, and so much later, as ``delays`` [s]."""
    scene.filter(IMAGES, lambda envelope: [delay(envelope, each) for each in delays(scene)])


@striking
def _restamped(scene: StruckRun, stamp: Callable[[int, StruckRun], int]) -> None:
    def change(message: Any) -> None:
        restamp(message, lambda stamp_ns: stamp(stamp_ns, scene))

    scene.alter(IMAGES, change)


OF_1970 = _restamped(lambda stamp_ns, scene: stamp_ns % (1_000_000 * NANOSECONDS))
OF_TOMORROW = _restamped(lambda stamp_ns, scene: stamp_ns + 86_400 * NANOSECONDS)
OF_CHANCE = _restamped(
    lambda stamp_ns, scene: stamp_ns + round(scene.draw(-2.0, 2.0) * NANOSECONDS)
)
OVERTAKING = _copies(lambda scene: [0.2 if scene.hits(0.3) else 0.0])
IMAGE_STREAM: Faults = {
    'images_dropped': Fault('up to half of the images are lost', drop_some(IMAGES)),
    'images_gap': always('no images for 0.3 to 8 s', _gap),
    'images_end': always('no image any more', lambda scene: scene.lose(IMAGES)),
    'images_late': Fault('images 0.1 to 0.5 s late', late(IMAGES, 0.1, 0.5)),
    'images_very_late': Fault('images 1.5 to 4 s late', late(IMAGES, 1.5, 4.0)),
    'images_uneven': Fault(
        'each image 0 to 0.5 s late', _copies(lambda scene: [scene.draw(0.0, 0.5)])
    ),
    'images_out_of_order': Fault('images overtake each other', OVERTAKING),
    'images_repeated': Fault(
        'each image comes three times', _copies(lambda scene: [0.0, 0.02, 0.04])
    ),
    'stamps_1970': Fault('stamps of 1970, in order', OF_1970),
    'stamps_zero': always('stamps of 0', _restamped(lambda stamp_ns, scene: 0)),
    'stamps_future': Fault('stamps of tomorrow', OF_TOMORROW),
    'stamps_random': Fault('stamps 2 s off, in any order', OF_CHANCE),
}


@striking
def _change_rows(
    scene: StruckRun, change: Callable[[Rows, StruckRun], Rows], *, true: bool = False
) -> None:
    """Let tracks have the rows that ``change`` makes; ``true`` where enough of them is left."""

    def alter(envelope: Envelope) -> list[Envelope]:
        message = envelope.message
        rows = change(np.frombuffer(message.data, TRACK_LAYOUT).copy(), scene)
        message.width, message.row_step = len(rows), len(rows) * message.point_step
        del message.data[:]
        message.data.frombytes(rows.tobytes())
        return [envelope if true else untrue(envelope)]

    scene.filter(TRACKS, alter, scene.spell(0.5, LONGEST_S))


def _half_random(rows: Rows, scene: StruckRun) -> Rows:
    wrong = scene.rng.random(len(rows)) < 0.5
    for name, size in (('u', 320.0), ('v', 256.0)):
        rows[name][wrong] = scene.rng.uniform(0.0, size, np.count_nonzero(wrong))
    return rows


def _half_shifted(rows: Rows, scene: StruckRun) -> Rows:
    """Let half of the features, always the same, be elsewhere, as those of what moves."""
    rows['u'][rows['id'] % 2 == 0] += 25.0
    return rows


def _nan(rows: Rows, scene: StruckRun) -> Rows:
    wrong = scene.rng.random(len(rows)) < scene.draw(0.0, 1.0)
    rows['u'][wrong] = np.nan
    rows['v'][scene.rng.random(len(rows)) < 0.1] = np.inf
    return rows


def _one_point(rows: Rows, scene: StruckRun) -> Rows:
    rows['u'], rows['v'] = 160.0, 128.0
    return rows


def _lying(scene: StruckRun) -> None:
    def lie(envelope: Envelope) -> list[Envelope]:
        message = envelope.message
        message.width = int(scene.rng.integers(0, 2**31))
        message.point_step = int(scene.rng.integers(0, 200))
        return [untrue(envelope)]

    scene.filter(TRACKS, lie, scene.spell(0.3, LONGEST_S))


FEW = _change_rows(lambda rows, scene: rows[: int(scene.rng.integers(1, 12))], true=True)
TRACK_STREAM: Faults = {
    'tracks_half_random': Fault(
        'half of the tracks anywhere', _change_rows(_half_random, true=True)
    ),
    'tracks_half_shifted': Fault(
        'half of the tracks 25 px aside', _change_rows(_half_shifted, true=True)
    ),
    'tracks_nan': Fault('nan and inf in tracks', _change_rows(_nan, true=True)),
    'tracks_empty': always('no features', _change_rows(lambda rows, scene: rows[:0])),
    'tracks_few': Fault('a few features', FEW),
    'tracks_one_point': Fault('all features at one point', _change_rows(_one_point)),
    'tracks_lying': always('clouds whose size lies', _lying),
    'tracks_dropped': Fault('up to half of the tracks lost', drop_some(TRACKS)),
    'tracks_late': Fault('tracks 0.1 to 0.5 s late', late(TRACKS, 0.1, 0.5)),
}
