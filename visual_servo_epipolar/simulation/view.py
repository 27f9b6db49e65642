"""View: the protocol of every source of features in a closed loop; the nod of a body."""

import math
from typing import NamedTuple, Protocol

from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.rigs.rig import Joints
from visual_servo_epipolar.core.tracking.features import Features

FREQUENCY = 2.0 * math.pi * 3.0  # [rad/s]
DAMPING = 0.12
STEP = 0.5  # of the acceleration [m/s^2], after which the pitch overshoots to its largest value
OVERSHOOT = math.exp(-math.pi * DAMPING / math.sqrt(1.0 - DAMPING**2))


class Nod(NamedTuple):
    """Pitch of the body, nose down positive [rad], and how fast it grows [rad/s]."""

    pitch: float = 0.0
    rate: float = 0.0

    def after(self, acceleration: float, dt: float, *, largest: float) -> 'Nod':
        """
        Return the nod after a short ``dt`` [s] of an ``acceleration`` ahead [m/s^2].

        ``largest`` is the largest pitch that a step of the acceleration by STEP causes [rad].
        """
        rest = -largest * acceleration / (STEP * (1.0 + OVERSHOOT))
        pull = FREQUENCY * (rest - self.pitch) - 2.0 * DAMPING * self.rate
        rate = self.rate + FREQUENCY * pull * dt
        return Nod(self.pitch + rate * dt, rate)

    def towards(self, later: 'Nod', share: float, seconds: float) -> 'Nod':
        """Return the nod at a ``share`` of the ``seconds`` to a ``later`` one: a cubic."""
        change = (later.pitch - self.pitch) / seconds
        bend = self.rate - 2.0 * change + later.rate
        start, middle = self.rate, 3.0 * change - 2.0 * self.rate - later.rate
        pitch = self.pitch + seconds * share * (start + share * (middle + share * bend))
        return Nod(pitch, start + share * (2.0 * middle + 3.0 * share * bend))


LEVEL = Nod()


class View(Protocol):
    """What stands between the world and the servo: points, or images and a tracker."""

    def observe(self, pose: Pose, frame: int) -> Features:
        """Return the features visible from ``pose`` in frame number ``frame``: 0, 1, ..."""

    def turn(self, joints: Joints) -> None:
        """Let the head that carries the camera have its joints at these angles from now on."""
        raise ValueError(f'{type(self).__name__} has no head to turn; simulate a fixed rig')

    def move(self, twist: Twist, nod: Nod = LEVEL) -> None:
        """Let base and body move so while images are exposed; an instant shows the pitch alone."""
