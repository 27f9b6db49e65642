"""
Rig: what carries the camera on the base, a fixed mount or a head that turns it.

Rays, limits of the view and bearings are in the axes of the rig: those of the camera (x right, y
down, z forward) with all joints at zero. How these sit on the base is told by ``Mount``, and
learnt while driving.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, TypeAlias

from visual_servo_epipolar.core.arrays import FloatArray


class Joints(NamedTuple):
    """Angles of the joints of a head [rad]: ``pan`` to the left, ``tilt`` down."""

    pan: float = 0.0
    tilt: float = 0.0


@dataclass(frozen=True, slots=True)
class HeadCommand:
    """Command to a head: the angles to which its joints are to turn [rad]."""

    pan: float = 0.0
    tilt: float = 0.0


Edges: TypeAlias = tuple[float, float]  # bearings of the ends of the view, right positive [rad]
AT_REST = Joints()


class Rig(Protocol):
    """What carries the camera: joint angles in; rays, limits of the view and its command out."""

    def rays(self, rays: FloatArray, joints: Joints) -> FloatArray:
        """Return unit rays, (N, 3), in axes of the rig, of those in axes of the camera."""
        ...

    def edges(self, edges: Edges, joints: Joints) -> Edges:
        """Return the limits of the view in axes of the rig, of those in axes of the camera."""
        ...

    def head_command(self, rays: FloatArray, joints: Joints) -> HeadCommand | None:
        """Return what the head does next by ``rays``, (N, 3), in axes of the rig; or None."""
        ...


RigFactory: TypeAlias = Callable[[], Rig]
