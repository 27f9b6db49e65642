"""Recipe of a base: another package brings one, and the servo drives with it."""

from dataclasses import dataclass, replace

import pytest
from untold_bases import driven

from visual_servo_epipolar.core.bases.base import BaseLimits
from visual_servo_epipolar.core.bases.differential_drive import DifferentialDrive
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.servo.settings import ServoSettings

FASTEST = 0.15  # of the tracks, whatever the settings allow [m/s]


@dataclass(frozen=True, slots=True)
class Tracks(DifferentialDrive):
    """Tracks, which turn in place but are slow."""

    def within_speed(self, wanted: Twist, *, ratio: float = 1.0) -> Twist:
        limits = replace(self.limits, max_linear=min(FASTEST, self.limits.max_linear))
        return DifferentialDrive(limits).within_speed(wanted, ratio=ratio)


def tracks(limits: BaseLimits) -> Tracks:
    return Tracks(limits)


def lorry(limits: BaseLimits) -> Tracks:
    return Tracks(limits, max_curvature=0.5)


def test_the_servo_drives_a_base_of_another_package(install) -> None:
    install('bases', 'tracks', f'{__name__}:tracks')
    slow, state = driven('nominal', 5, {}, {'base': 'tracks'})
    assert slow['outcome'] == 'arrived', slow['reason']
    assert 0.9 * FASTEST < float(str(slow['max_linear_speed'])) <= FASTEST + 1e-12
    usual, _ = driven('nominal', 5, {}, {})
    assert float(str(usual['max_linear_speed'])) > 2.0 * FASTEST


def test_a_law_that_turns_in_place_refuses_a_base_that_does_not(install) -> None:
    install('bases', 'lorry', f'{__name__}:lorry')
    with pytest.raises(ValueError, match='orienting, base lorry drives curves of 0.5 1/m at most'):
        ServoSettings(base='lorry', law='full')
