"""Camera on a pan-tilt head: its joints and encoders, and where the camera is when they turn."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
import math
from typing import Any, ClassVar

import numpy as np

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.rigs.rig import AT_REST, HeadCommand, Joints
from visual_servo_epipolar.core.settings import internal, setting, Settings
from visual_servo_epipolar.core.stamps import NANOSECONDS, seconds_between
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.mounts.mounting import FixedRig
from visual_servo_epipolar.simulation.mounts.sensor import DESIRED_FRAME
from visual_servo_epipolar.simulation.mounts.simulated_rig import CameraPose

RATE_S = 0.2  # for which a commanded rate holds
TILT_LIMIT, ACCELERATION = 0.6, 10.0  # of a joint: up or down [rad], [rad/s^2]


@dataclass(frozen=True, kw_only=True)
class HeadSettings(Settings):
    """A pan-tilt head and what is wrong with it; the defaults are a usual servo's."""

    head_pan_limit: float = setting(
        1.745, 'Largest pan angle to either side [rad]', low=0.0, high=6.2
    )
    head_speed: float = setting(2.0, 'Speed of a joint [rad/s]', low=0.01, high=50.0)
    head_delay: float = internal(0.05, 'Delay from command to motion [s]', low=0.0, high=1.0)
    head_encoder_noise: float = internal(
        3e-4, 'Deviation of an angle that is read [rad]', low=0.0, high=0.1
    )
    head_encoder_offset: float = internal(
        0.0, 'Pan angle that is read where the head looks ahead [rad]', low=-0.5, high=0.5
    )
    GONE: ClassVar[Mapping[str, Any]] = {
        'head_start_pan': 0.0,
        'head_tilt_limit': 0.6,
        'head_acceleration': 10.0,
        'head_lever': 0.0,
    }


class SimulatedHead:
    """
    Head in simulated time [ns]: commands in; ``joints``, the true angles, and ``read`` ones out.

    It moves in ``advance`` alone. A command is an angle for each joint, which the head's own
    controller goes to at its speed and stops at; or, where angles are nan, a rate for RATE_S.
    """

    def __init__(self, settings: HeadSettings, *, seed: int, now_ns: int = 0) -> None:
        self.settings, self.now_ns, self._seed = settings, now_ns, seed
        self._angles, self._rates = [0.0, 0.0], [0.0, 0.0]
        self._goals = [0.0, 0.0]
        self._pending: deque[tuple[int, HeadCommand]] = deque()
        self._readings = 0

    @property
    def joints(self) -> Joints:
        """The true angles [rad]."""
        return Joints(*self._angles)

    def read(self) -> Joints:
        """Return what the encoders say, with the noise of this reading."""
        rng = np.random.default_rng((self._seed, 9, self._readings))
        self._readings += 1
        pan, tilt = (self.settings.head_encoder_noise * rng.standard_normal(2)).tolist()
        offset = self.settings.head_encoder_offset
        return Joints(self._angles[0] + offset + pan, self._angles[1] + tilt)

    def command(self, command: HeadCommand | None) -> None:
        """Take ``command`` now; it counts after the delay; None leaves the one before."""
        if command is not None:
            delay_ns = round(self.settings.head_delay * NANOSECONDS)
            self._pending.append((self.now_ns + delay_ns, command))

    def advance(self, now_ns: int) -> None:
        """Move until ``now_ns`` [ns]."""
        while self.now_ns < now_ns:
            until_ns = min(self.now_ns + NANOSECONDS // 100, now_ns)
            while self._pending and self._pending[0][0] <= self.now_ns:
                self._obey(self._pending.popleft()[1])
            dt, self.now_ns = seconds_between(self.now_ns, until_ns), until_ns
            limits = self.settings.head_pan_limit, TILT_LIMIT
            for joint, limit in enumerate(limits):
                self._move(joint, min(max(self._goals[joint], -limit), limit), dt)

    def _obey(self, command: HeadCommand) -> None:
        """Take up a command that has arrived."""
        if math.isnan(command.pan):
            pan, tilt = self._angles
            self._goals = [pan + RATE_S * command.pan_rate, tilt + RATE_S * command.tilt_rate]
        else:
            self._goals = [command.pan - self.settings.head_encoder_offset, command.tilt]

    def _move(self, joint: int, goal: float, dt: float) -> None:
        """Move one joint towards ``goal`` for ``dt`` [s], so that it can stop there."""
        left, most = goal - self._angles[joint], ACCELERATION
        late = most * dt
        wanted = min(math.sqrt(late * late + 2.0 * most * abs(left)) - late, abs(left) / dt)
        wanted = math.copysign(min(wanted, self.settings.head_speed), left)
        rate = self._rates[joint]
        self._rates[joint] = rate + min(max(wanted - rate, -late), late)
        self._angles[joint] += self._rates[joint] * dt


VIEWS = 15  # from end to end of a pan joint


@dataclass(frozen=True, kw_only=True)
class PanTiltSettings(HeadSettings, CameraSettings):
    """A camera that a head turns, and the head, with its pan axis at the mount."""


@dataclass(frozen=True, slots=True)
class PanTiltRig(FixedRig):
    """
    A camera on a head, the pan axis at ``mount``; ``joints`` are the true angles [rad].

    The photograph is taken at ``rest``: where encoders that are off by an offset read zero.
    """

    pan_limit: float = 0.0
    rest: Joints = AT_REST
    joints: Joints | None = None

    @property
    def views(self) -> tuple[FixedRig, ...]:
        """The rig at rest, and panned from end to end."""
        pans = np.linspace(-self.pan_limit, self.pan_limit, VIEWS).tolist()
        return self, *(self.turned(Joints(pan)) for pan in pans)

    def turned(self, joints: Joints) -> 'PanTiltRig':
        """Return the rig with these joints."""
        return replace(self, joints=joints)

    def camera_pose(self, pose: Pose, frame: int | None = None) -> CameraPose:
        """Return where the camera is; joints are at rest unless they were turned."""
        joints = None if frame == DESIRED_FRAME else self.joints
        return self.placed(pose, frame, joints or self.rest)


def pan_tilt_rig(settings: PanTiltSettings) -> PanTiltRig:
    """Return the rig that ``settings`` describe."""
    return PanTiltRig(
        settings.camera,
        settings.mount,
        settings.jitter,
        settings.seed,
        settings.bumps,
        pan_limit=settings.head_pan_limit,
        rest=Joints(-settings.head_encoder_offset),
    )
