"""
Rig: a fixed mount, or a head that turns the camera.

Rays, limits of the view and bearings are in the axes of the rig: those of the camera (x right, y
down, z forward) with all joints at zero. How these sit on the base is the ``Mount``, and
learnt while driving.
"""

from collections.abc import Callable
from dataclasses import dataclass
import math
from typing import NamedTuple, Protocol, TypeAlias

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist


class Joints(NamedTuple):
    """Angles of the joints of a head [rad]: ``pan`` to the left, ``tilt`` down."""

    pan: float = 0.0
    tilt: float = 0.0


@dataclass(frozen=True, slots=True)
class HeadCommand:
    """Command to a head: angles to which its joints are to turn [rad], at which rates [rad/s]."""

    pan: float = 0.0
    tilt: float = 0.0
    pan_rate: float = 0.0
    tilt_rate: float = 0.0


@dataclass(frozen=True, slots=True)
class Command:
    """
    Command of one control step: the ``twist`` of the base [m/s, rad/s], and that to a ``head``.

    A base and the publisher of the servo take it whole, so that every field reaches both. None is
    that of a rig without a head, and leaves any other as it is.
    """

    twist: Twist = STANDSTILL
    head: HeadCommand | None = None


HALT = Command()
Edges: TypeAlias = tuple[float, float]  # bearings of the ends of the view, right positive [rad]
AT_REST = Joints()


@dataclass(frozen=True, slots=True)
class HeadLimits:
    """
    Limits of a head as its settings have them, and how its camera sits on it [rad, rad/s].

    ``photograph`` has the angles at which the photograph was taken, ``latency`` is the time from
    a command to the motion [s], ``tilt`` and ``roll`` are those of the camera at joints of zero.
    """

    pan_min: float = -math.radians(100.0)
    pan_max: float = math.radians(100.0)
    pan_speed: float = 1.5
    latency: float = 0.1
    photograph: Joints = AT_REST
    tilt: float = 0.0
    roll: float = 0.0


class Gaze(NamedTuple):
    """
    What a head goes by: its ``joints`` when the image was taken, and what that showed.

    Rays, (N, 3), in axes of the rig, ``current`` and ``desired``; the ``twist`` that the base was
    sent, the time until the next image [s], and for how long too little was seen [s].
    """

    joints: Joints
    current: FloatArray
    desired: FloatArray
    twist: Twist = STANDSTILL
    period: float = 0.0
    lost: float = 0.0


class Lean(NamedTuple):
    """How a camera sits on its rig at joints of zero: ``tilt`` down, ``roll`` clockwise [rad]."""

    tilt: float
    roll: float


class HeadView(NamedTuple):
    """Angles of a ``rig`` at an image, and the ``reach``: edges of all its views [rad]."""

    joints: Joints
    reach: Edges
    rig: 'Rig'


class Rig(Protocol):
    """What carries the camera: joint angles in; rays, limits of the view and its command out."""

    @property
    def turn_rate(self) -> float:
        """Rate at which joints turn the camera against the base [rad/s]; 0 where none does."""

    @property
    def search_time(self) -> float:
        """Time that it takes to look everywhere [s]; 0 where no joint turns."""

    @property
    def photograph(self) -> Joints:
        """Angles of the joints at which the photograph was taken."""

    def rays(self, rays: FloatArray, joints: Joints, lean: Lean | None = None) -> FloatArray:
        """
        Return unit rays, (N, 3), in axes of the rig, of those in axes of the camera.

        ``lean`` is that of the camera, None as it is configured.
        """

    def edges(self, edges: Edges, joints: Joints) -> Edges:
        """Return the limits of the view in axes of the rig, of those in axes of the camera."""

    def reach(self, edges: Edges) -> Edges:
        """Return the limits of all views that joints allow, of those in axes of the camera."""

    def head_command(self, gaze: Gaze) -> HeadCommand | None:
        """Return what the head does next; None of a rig without one."""


RigFactory: TypeAlias = Callable[[HeadLimits], Rig]
