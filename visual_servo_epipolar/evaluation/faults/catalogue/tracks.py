"""Faults of tracks: wrong ones, and clouds that lie about themselves."""

from collections.abc import Callable
from typing import Any

import numpy as np

from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    always,
    Fault,
    Faults,
    Strike,
    StruckRun,
)
from visual_servo_epipolar.evaluation.faults.catalogue.streams import drop_some, late
from visual_servo_epipolar.evaluation.live.wire import Envelope
from visual_servo_epipolar.messages.write import TRACK_LAYOUT

TRACKS = '/tracks'
LONGEST_S = 10.0
Rows = Any


def _change_rows(change: Callable[[Rows, StruckRun], Rows], *, true: bool = False) -> Strike:
    """Return tracks whose rows ``change``; ``true`` where enough of them is left."""

    def strike(scene: StruckRun) -> None:
        def alter(envelope: Envelope) -> list[Envelope]:
            message = envelope.message
            rows = change(np.frombuffer(message.data, TRACK_LAYOUT).copy(), scene)
            message.width, message.row_step = len(rows), len(rows) * message.point_step
            del message.data[:]
            message.data.frombytes(rows.tobytes())
            sight = envelope.sight if true else envelope.sight and envelope.sight.lie()
            return [envelope.changed(sight=sight)]

        scene.filter(TRACKS, alter, scene.spell(0.5, LONGEST_S))

    return strike


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
        return [envelope.changed(sight=envelope.sight and envelope.sight.lie())]

    scene.filter(TRACKS, lie, scene.spell(0.3, LONGEST_S))


NONE = _change_rows(lambda rows, scene: rows[:0])
FEW = _change_rows(lambda rows, scene: rows[: int(scene.rng.integers(1, 12))], true=True)
FAULTS: Faults = {
    'tracks_half_random': Fault(
        'half of the tracks anywhere', _change_rows(_half_random, true=True)
    ),
    'tracks_half_shifted': Fault(
        'half of the tracks 25 px aside', _change_rows(_half_shifted, true=True)
    ),
    'tracks_nan': Fault('nan and inf in tracks', _change_rows(_nan, true=True)),
    'tracks_empty': always('no features', NONE),
    'tracks_few': Fault('a few features', FEW),
    'tracks_one_point': Fault('all features at one point', _change_rows(_one_point)),
    'tracks_lying': always('clouds whose size lies', _lying),
    'tracks_dropped': Fault('up to half of the tracks lost', drop_some(TRACKS)),
    'tracks_late': Fault('tracks 0.1 to 0.5 s late', late(TRACKS, 0.1, 0.5)),
}
