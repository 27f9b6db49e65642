"""Fixed mount: the pose on the base of a camera that no joint turns, and its margins."""

from dataclasses import asdict, dataclass, replace
import math
from typing import TypeVar

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.rigs.rig import AT_REST, Edges, Gaze, Joints, Lean
from visual_servo_epipolar.core.settings import Settings

STEEPEST = math.radians(46.0)  # of an optical axis off the floor's plane
MISSHAPEN = 1e-6  # largest element of R^T R - 1 of what is a rotation
SettingsT = TypeVar('SettingsT', bound=Settings)


@dataclass(frozen=True, slots=True)
class FixedMount:
    """Rig without joints: axes of the camera are those of the rig."""

    turn_rate: float = 0.0
    search_time: float = 0.0
    photograph: Joints = AT_REST

    def rays(self, rays: FloatArray, joints: Joints, lean: Lean | None = None) -> FloatArray:
        """Return ``rays`` as they are."""
        return rays

    def edges(self, edges: Edges, joints: Joints) -> Edges:
        """Return ``edges`` as they are."""
        return edges

    def reach(self, edges: Edges) -> Edges:
        """Return ``edges`` as they are."""
        return edges

    def head_command(self, gaze: Gaze) -> None:
        """Return None: there is no head."""
        return None


@dataclass(frozen=True, slots=True)
class Mount:
    """
    Mount of a camera on the base, whose axes are x forward, y left, z up (REP 103).

    ``tilt``, down positive, ``roll``, clockwise, ``yaw``, to the left [rad]; offset from the
    middle of the axle, ``forward`` and ``left`` [m]. Its height does not matter.
    """

    tilt: float
    roll: float
    yaw: float
    forward: float
    left: float

    def __str__(self) -> str:
        tilt, roll, yaw = (f'{math.degrees(a):.1f} deg' for a in (self.tilt, self.roll, self.yaw))
        place = f'{self.forward:.3f} m ahead, {self.left:.3f} m to the left'
        return f'tilt {tilt}, roll {roll}, yaw {yaw}, {place}'


def mount_of(R_base_camera: FloatArray, origin: FloatArray) -> Mount:
    """
    Return the mount of an optical frame (x right, y down, z forward).

    Parameters
    ----------
    R_base_camera : array, shape (3, 3)
        Turns axes of the camera into those of the base.
    origin : array, shape (3,)
        The camera's centre in the base's frame [m].

    Raises ValueError if it is no rotation, or looks up or down too steeply for an optical frame on
    a robot.

    """
    whole = np.isfinite(R_base_camera).all() and np.isfinite(origin).all()
    if not whole or np.abs(R_base_camera.T @ R_base_camera - np.eye(3)).max() > MISSHAPEN:
        raise ValueError('a mount must be a rotation and a place, all finite')
    x, y, z = R_base_camera[:, 2].tolist()
    if abs(z) > math.sin(STEEPEST):
        raise ValueError(
            f'z of the camera frame points {math.degrees(math.asin(min(abs(z), 1.0))):.0f} deg '
            f'{"up" if z > 0.0 else "down"}, an optical frame looks ahead (x right, y down); '
            'camera_info and images must carry the optical frame (REP 103)'
        )
    yaw = math.atan2(y, x)
    sine, cosine = math.sin(yaw), math.cos(yaw)
    level = np.array([[sine, -cosine, 0.0], [0.0, 0.0, -1.0], [cosine, sine, 0.0]])
    turned = level @ R_base_camera
    return Mount(
        tilt=math.atan2(turned[1, 2], turned[2, 2]),
        roll=math.atan2(-turned[0, 1], turned[0, 0]),
        yaw=yaw,
        forward=float(origin[0]),
        left=float(origin[1]),
    )


AHEAD = Mount(tilt=0.0, roll=0.0, yaw=0.0, forward=0.0, left=0.0)


def is_configured(settings: Settings) -> bool:
    """Return whether any of the ``settings`` says how the camera is mounted."""
    return any(getattr(settings, f'camera_{name}') for name in asdict(AHEAD))


def with_mount(settings: SettingsT, mount: Mount) -> SettingsT:
    """
    Return the settings of a camera mounted as in a description of the robot.

    A drawing is seldom measured: deviations stay what they are. Raises ValueError if it is beyond
    what the settings allow.
    """
    return replace(settings, **{f'camera_{name}': value for name, value in asdict(mount).items()})


def camera_swing(before: float, heading: float) -> FloatArray:
    """
    Return by how much a turn from ``before`` to ``heading`` [rad] moves the camera, a metre each.

    Columns are a camera ahead of the axle and one to the left of it, rows are right and ahead, in
    axes of the goal's camera.
    """
    sine = math.sin(heading) - math.sin(before)
    cosine = math.cos(heading) - math.cos(before)
    return np.array([[-sine, -cosine], [cosine, -sine]])


def offset_at_axle(
    offset: tuple[float, float], heading: float, mount: FloatArray
) -> tuple[float, float]:
    """Return where the axle is, right and ahead of the goal's [m], by the camera's offset."""
    x, y = axle_offset(offset, heading, mount)
    cosine, sine = math.cos(mount[0]), math.sin(mount[0])
    return cosine * x - sine * y, sine * x + cosine * y


def at_axle(bearings: Bearings, mount: FloatArray, distance: float) -> Bearings:
    """Return the bearings of the axle in axes of the base, from those of its camera."""
    offset = distance * math.cos(bearings.psi), distance * math.sin(bearings.psi)
    x, y = axle_offset(offset, bearings.heading_error, mount)
    psi, theta = math.atan2(y, x) + float(mount[0]), bearings.psi - bearings.phi
    return Bearings(math.remainder(psi, 2.0 * math.pi), math.remainder(psi - theta, 2.0 * math.pi))


def axle_offset(
    offset: tuple[float, float], heading: float, mount: FloatArray
) -> tuple[float, float]:
    """Return the offset of the axle from the goal's, in axes of the goal's camera [m]."""
    swing_x, swing_y = (camera_swing(0.0, heading) @ mount[1:]).tolist()
    return offset[0] - swing_x, offset[1] - swing_y
