"""Faults of light: switched off while driving, a window that opens, an exposure that leaps."""

from dataclasses import replace
from typing import Any

import numpy as np

from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    Fault,
    Faults,
    Prepare,
    StruckRun,
)
from visual_servo_epipolar.evaluation.live.world import WorldSettings

CAMERA = 'camera_node'
OFF_S = 2.0  # how long it is dark
LEAPS, LEAP = 8, (0.3, 2.0)  # of the exposure, and how long each lasts [s]
PASSING = {'disturbed_from': 0, 'disturbed_for': 10**6}  # always


def _exposing(mode: str) -> Prepare:
    """Return a world whose camera has an exposure that is fixed, or follows."""

    def prepare(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
        return replace(settings, more={**settings.more, CAMERA: {'exposure': mode}})

    return prepare


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


FAULTS: Faults = {
    'light_off': Fault('light off for 2 s', _off_and_on),
    'light_off_auto': Fault(
        'the light goes off, and on after 2 s; the exposure follows',
        _off_and_on,
        _exposing('auto'),
    ),
    'window_opened': Fault(
        'a window opens in view, and the exposure follows', _open_window, _exposing('auto')
    ),
    'exposure_leaps': Fault('the exposure leaps by a factor of two', _leap),
}
