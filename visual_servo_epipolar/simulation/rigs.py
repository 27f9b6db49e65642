"""Camera rigs: where a camera is with the robot at a pose; mounts, uneven floors, the truth."""

from dataclasses import dataclass
from functools import lru_cache
import math
from typing import NamedTuple

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, frozen
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import (
    compose,
    DESIRED_POSE,
    integrate,
    Pose,
    relative_pose,
)
from visual_servo_epipolar.core.rigs.rig import AT_REST, Joints
from visual_servo_epipolar.simulation.sensor import CameraMotion, DESIRED_FRAME


class CameraPose(NamedTuple):
    """A camera in the world: axes right, down, forward as columns, (3, 3); centre, (3,) [m]."""

    R_world_camera: FloatArray
    centre: FloatArray


def leaned(
    camera: CameraPose, pose: Pose, turn: tuple[float, float, float], rise: float = 0.0
) -> CameraPose:
    """
    Return ``camera`` on a robot at ``pose`` that leans by a ``turn`` about world axes [rad].

    It leans about the middle of its axle, on the floor, which is higher by ``rise`` [m].
    """
    R_leaned = np.asarray(cv2.Rodrigues(np.array(turn))[0])
    foot = np.array([pose.x, pose.y, 0.0])
    centre = foot + R_leaned @ (camera.centre - foot) + (0.0, 0.0, rise)
    return CameraPose(R_leaned @ camera.R_world_camera, centre)


def pitched(camera: CameraPose, pose: Pose, pitch: float) -> CameraPose:
    """Return ``camera`` on a robot at ``pose`` whose body leans ahead by ``pitch`` [rad]."""
    sin, cos = math.sin(pose.theta), math.cos(pose.theta)
    return leaned(camera, pose, (-pitch * sin, pitch * cos, 0.0))


VIEWS = 15  # of a head from end to end of its pan joint
BLOCK = 64  # frames drawn at once: starting a random generator costs more than drawing
WAVES, WAVELENGTHS_M = 4, (1.2, 2.4)  # of a floor: 5 mm lean a robot by up to 1 to 1.5 deg


@dataclass(frozen=True, slots=True)
class CameraMount:
    """
    Where the camera sits on the base: height, offset ahead and left of the axle [m], angles [rad].

    A positive yaw turns the camera about the vertical, to the left (counter-clockwise from above,
    as in REP 103); it comes first, then tilt and roll in the axes so turned. A positive tilt
    looks down; a positive roll turns the camera clockwise, seen from behind it. At yaw the camera
    looks past where the robot drives to, but the goal is the same: the robot at its desired pose.
    """

    height: float = 0.6
    forward: float = 0.0
    tilt: float = 0.0
    roll: float = 0.0
    left: float = 0.0
    yaw: float = 0.0

    def centre(self, pose: Pose) -> FloatArray:
        """Return the optical centre in the world, shape (3,) [m]."""
        sin, cos = math.sin(pose.theta), math.cos(pose.theta)
        x = pose.x + self.forward * cos - self.left * sin
        y = pose.y + self.forward * sin + self.left * cos
        return np.array([x, y, self.height])

    def R_world_camera(self, pose: Pose, *, tilt: float = 0.0, roll: float = 0.0) -> FloatArray:
        """Return axes right, down, forward as columns, (3, 3), with tilt and roll [rad] added."""
        heading = pose.theta + self.yaw
        sin, cos = math.sin(heading), math.cos(heading)
        level = np.array([[sin, 0.0, cos], [-cos, 0.0, sin], [0.0, -1.0, 0.0]])
        sin, cos = math.sin(self.tilt + tilt), math.cos(self.tilt + tilt)
        tilted = level @ np.array([[1.0, 0.0, 0.0], [0.0, cos, sin], [0.0, -sin, cos]])
        sin, cos = math.sin(self.roll + roll), math.cos(self.roll + roll)
        return np.asarray(tilted @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]))


def floor_jitter(deviation: float, seed: int, frame: int) -> tuple[float, float]:
    """
    Return by how much the floor tilts and rolls the camera in ``frame``: -1, 0, 1, ... [rad].

    Normal, of ``deviation`` [rad], and anew for each frame; the photograph, frame -1, has its own.
    """
    if deviation == 0.0:
        return 0.0, 0.0
    block, number = divmod(frame - DESIRED_FRAME, BLOCK)
    tilt, roll = _bumps(seed, block)[number].tolist()
    return deviation * tilt, deviation * roll


@lru_cache(maxsize=1024)
def _bumps(seed: int, block: int) -> FloatArray:
    """Return tilt and roll of a block of frames, unit deviation, shape (BLOCK, 2)."""
    return frozen(np.random.default_rng((seed, 4, block)).standard_normal((BLOCK, 2)))


@lru_cache(maxsize=64)
def _waves(seed: int) -> tuple[tuple[float, float, float], ...]:
    """Return waves of the floor, of unit height: a vector (x, y) [rad/m], the phase at (0, 0)."""
    rng = np.random.default_rng((seed, 10))
    numbers = 2.0 * math.pi / rng.uniform(*WAVELENGTHS_M, WAVES)
    directions, phases = rng.uniform(0.0, 2.0 * math.pi, (2, WAVES))
    waves = numbers * np.cos(directions), numbers * np.sin(directions), phases
    return tuple(zip(*(each.tolist() for each in waves), strict=True))


def on_bumps(camera: CameraPose, pose: Pose, bumps: float, seed: int) -> CameraPose:
    """
    Return ``camera`` of a robot that stands at ``pose`` on the bumps of a floor, by its seed.

    They are up to ``bumps`` [m] high, smooth, and where they are for ever; a robot rises and leans
    with them as a whole.
    """
    if bumps == 0.0:
        return camera
    height, slope_x, slope_y = 0.0, 0.0, 0.0
    for x, y, phase in _waves(seed):
        angle, amplitude = x * pose.x + y * pose.y + phase, bumps / math.sqrt(WAVES)
        height += amplitude * math.sin(angle)
        slope_x += amplitude * x * math.cos(angle)
        slope_y += amplitude * y * math.cos(angle)
    return leaned(camera, pose, (slope_y, -slope_x, 0.0), height)


@dataclass(frozen=True, slots=True)
class SimulatedRig:
    """
    A camera on its mount, on a floor with ``jitter`` [rad] and ``bumps`` [m], both seeded.

    A head, whose axes meet at the mount, turns it to either side by ``pan_limit`` [rad] at most.
    All that a rig does follows from pose, joints and frame: -1 of the photograph, 0, 1, ...; or
    None, a level floor that shakes nothing.
    """

    camera: CameraModel
    mount: CameraMount = CameraMount()
    jitter: float = 0.0
    seed: int = 0
    bumps: float = 0.0
    pan_limit: float = 0.0

    @property
    def gazes(self) -> tuple[Joints, ...]:
        """The joints of a head, so closely that nothing is seen in between alone; rest first."""
        if self.pan_limit == 0.0:
            return (AT_REST,)
        pans = np.linspace(-self.pan_limit, self.pan_limit, VIEWS).tolist()
        return AT_REST, *map(Joints, pans)

    def camera_pose(
        self, pose: Pose, frame: int | None = None, joints: Joints = AT_REST
    ) -> CameraPose:
        """Return where the camera is with the robot at ``pose``, turned by ``joints`` below it."""
        tilt, roll = (0.0, 0.0) if frame is None else floor_jitter(self.jitter, self.seed, frame)
        panned = Pose(pose.x, pose.y, pose.theta + joints.pan)
        axes = self.mount.R_world_camera(panned, tilt=joints.tilt + tilt, roll=roll)
        bumps = 0.0 if frame is None else self.bumps
        return on_bumps(CameraPose(axes, self.mount.centre(pose)), pose, bumps, self.seed)


def exposed_from(
    rig: SimulatedRig, pose: Pose, frame: int | None, motion: CameraMotion, time: float = 0.0
) -> CameraPose:
    """Return where the camera is ``time`` [s] after its robot was at ``pose``, in a ``motion``."""
    pose = integrate(pose, motion.twist, time) if time else pose
    place = rig.camera_pose(pose, frame, motion.joints)
    pitch = motion.nod.pitch + motion.nod.rate * time
    return pitched(place, pose, pitch) if pitch else place


def upright_view(rig: SimulatedRig, pose: Pose, frame: int | None = None) -> Pose:
    """
    Return where the camera is in ``frame`` as that of the photograph sees it, both upright.

    They stand at the true centres and look where the true ones look: offset and yaw of the mount
    count, tilt and roll do not. In the plane of the paper, the photograph was taken at its goal.
    """
    views = []
    for robot, number in ((DESIRED_POSE, DESIRED_FRAME), (pose, frame)):
        axes, centre = rig.camera_pose(robot, number)
        views.append(np.array([centre[0], centre[1], math.atan2(axes[1, 2], axes[0, 2])]))
    goal = np.array([DESIRED_POSE.x, DESIRED_POSE.y, DESIRED_POSE.theta])
    return Pose(*compose(goal, relative_pose(*views)).tolist())
