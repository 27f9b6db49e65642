"""A simulated Pioneer 3-DX: limits of speed and acceleration, wheels, drifting odometry."""

from array import array
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any, ClassVar

import numpy as np

from visual_servo_epipolar.core.geometry.motion import (
    arc,
    integrate,
    Pose,
    saturate,
    STANDSTILL,
    Twist,
)
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.settings import internal, setting, Settings
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.simulation.view import LEVEL

SUBSTEP_S = 0.01  # accelerations are held constant this long
SWIVEL_M = 0.08  # way on which casters swivel after the direction of travel has reversed


@dataclass(frozen=True, kw_only=True)
class PioneerSettings(Settings):
    """A differential drive and what is wrong with it; the defaults are a healthy Pioneer 3-DX."""

    max_linear: float = setting(1.0, 'Largest linear speed [m/s]', low=0.01, high=5.0)
    max_angular: float = setting(1.74, 'Largest angular speed [rad/s]', low=0.01, high=10.0)
    acceleration: float = setting(0.3, 'Linear acceleration [m/s^2]', low=0.01, high=20.0)
    deceleration: float = setting(0.6, 'Linear deceleration [m/s^2]', low=0.01, high=20.0)
    angular_acceleration: float = internal(
        1.74, 'Angular acceleration [rad/s^2]', low=0.01, high=50.0
    )
    track: float = internal(0.33, 'Distance between the wheels [m]', low=0.05, high=2.0)
    command_timeout: float = setting(
        0.5, 'Age of the last command at which the base stops; 0 = never [s]', low=0.0, high=60.0
    )
    odometry_noise: float = internal(
        0.0075, 'Deviation of wheel odometry, a metre and a radian', low=0.0, high=1.0
    )
    wheel_ratio: float = setting(
        1.0, 'True radius of the right wheel over the left', low=0.8, high=1.25
    )
    slip: float = setting(0.0, "Part of the wheels' motion lost in slip", low=0.0, high=0.9)
    dead_zone_linear: float = setting(
        0.0, 'Linear speed below which the motors stand [m/s]', low=0.0, high=1.0
    )
    dead_zone_angular: float = setting(
        0.0, 'Angular speed below which the motors stand [rad/s]', low=0.0, high=2.0
    )
    command_delay: float = setting(0.0, 'Delay from command to motors [s]', low=0.0, high=2.0)
    step_linear: float = internal(
        0.0, 'Linear speeds are multiples of it; 0 = any speed [m/s]', low=0.0, high=0.5
    )
    step_angular: float = internal(
        0.0, 'Angular speeds are multiples of it; 0 = any speed [rad/s]', low=0.0, high=1.0
    )
    caster_kick: float = internal(
        0.0, 'Turn by which casters that swivel push the base aside [rad]', low=0.0, high=0.5
    )
    nod: float = internal(
        0.0,
        'Pitch of the body on its springs after a step of 0.5 m/s^2: it nods at 3 Hz [rad]',
        low=0.0,
        high=0.1,
    )
    GONE: ClassVar[Mapping[str, Any]] = {'wheel_radius': 0.0975}


class Pioneer:
    """
    The base, advanced in simulated time [ns] by ``advance``; commands come in by ``command``.

    ``pose`` is ground truth, ``twist`` the true velocity, ``nodding`` the pitch of the body,
    ``odometry`` what the wheels report: it starts at (0, 0, 0) and drifts.
    """

    def __init__(
        self, settings: PioneerSettings, pose: Pose, *, seed: int, now_ns: int = 0
    ) -> None:
        self.settings = settings
        self.pose = pose
        self.twist, self.nodding = STANDSTILL, LEVEL
        self.now_ns = now_ns
        self.wanted = STANDSTILL
        self._wheels = (0.0, 0.0)  # what the motors turn, as seen by nominal wheels
        self._pending: deque[tuple[int, Twist]] = deque()
        self._command_ns: int | None = None
        self._rng = np.random.default_rng((seed, 1))
        self._kicks = np.random.default_rng((seed, 9))
        self._kick = 0.0  # curvature of casters that swivel [1/m]
        self._swivelled, self._direction = SWIVEL_M, 0.0  # way since the reversal [m], its sign
        self._odometry = Pose(0.0, 0.0, 0.0)
        self._unread = array('d')  # wheels, time and noise of each step that odometry lacks

    def command(self, command: Command) -> None:
        """Take ``command`` now; it reaches the motors ``command_delay`` later."""
        self._command_ns = self.now_ns
        delay_ns = round(self.settings.command_delay * NANOSECONDS)
        self._pending.append((self.now_ns + delay_ns, command.twist))

    def halt(self) -> None:
        """Forget every command and brake, as on a refused command."""
        self._pending.clear()
        self.wanted = STANDSTILL

    @property
    def timed_out(self) -> bool:
        """Whether the last command is older than ``command_timeout``."""
        timeout = self.settings.command_timeout
        if timeout == 0.0 or self._command_ns is None:
            return False
        return self.now_ns - self._command_ns > timeout * NANOSECONDS

    @property
    def odometry(self) -> Pose:
        """Where the wheels say the robot is, added up when it is asked for."""
        steps = np.array(self._unread).reshape(-1, 4)
        chance = self._rng.standard_normal((len(steps), 2)).tolist()
        for (linear, angular, dt, noise), (ahead, aside) in zip(
            steps.tolist(), chance, strict=True
        ):
            # A random walk: the variance grows with the way, so that the step does not matter.
            way, turn = abs(linear) * dt, abs(angular) * dt
            measured = Twist(
                linear + noise * math.sqrt(way) * ahead / dt,
                angular + noise * math.sqrt(way + turn) * aside / dt,
            )
            self._odometry = integrate(self._odometry, measured, dt)
        del self._unread[:]
        return self._odometry

    def advance(self, now_ns: int) -> None:
        """Move until ``now_ns``; a time that is not later moves nothing."""
        duration = (now_ns - self.now_ns) / NANOSECONDS
        if duration <= 0.0:
            return
        steps, start_ns = math.ceil(duration / SUBSTEP_S), self.now_ns
        dt, noise = duration / steps, self.settings.odometry_noise
        x, y, theta = self.pose.x, self.pose.y, self.pose.theta
        twist, aim, due_ns = self._true(*self._wheels), self._limited(self.wanted), self._due_ns
        for number in range(1, steps + 1):
            if self.now_ns >= due_ns:
                self._receive()
                aim, due_ns = self._limited(self.wanted), self._due_ns
            wheels = self._accelerated(*aim, dt)
            if self.settings.nod > 0.0:
                faster = (wheels[0] - self._wheels[0]) / dt
                self.nodding = self.nodding.after(faster, dt, largest=self.settings.nod)
            if wheels is not self._wheels:
                twist, self._wheels = self._true(*wheels), wheels
            if twist != (0.0, 0.0):
                x, y, theta = arc(x, y, theta, *twist, dt)
                theta += self._swivel(twist[0] * dt)
            self._unread.extend((*wheels, dt, noise))
            self.now_ns = start_ns + (now_ns - start_ns) * number // steps
        self.pose, self.twist = Pose(x, y, theta), Twist(*twist)

    @property
    def _due_ns(self) -> float:
        """When the next command reaches the motors, or the last one is too old."""
        due_ns = self._pending[0][0] if self._pending else math.inf
        timeout = self.settings.command_timeout
        if timeout == 0.0 or self._command_ns is None:
            return due_ns
        return min(due_ns, self._command_ns + math.floor(timeout * NANOSECONDS) + 1)

    def _receive(self) -> None:
        """Take what reaches the motors now."""
        while self._pending and self._pending[0][0] <= self.now_ns:
            self.wanted = self._pending.popleft()[1]
        if self.timed_out:
            self.halt()

    def _limited(self, twist: Twist) -> tuple[float, float]:
        limits = self.settings
        twist = saturate(twist, max_linear=limits.max_linear, max_angular=limits.max_angular)
        return (
            obeyed(twist.linear, limits.dead_zone_linear, limits.step_linear),
            obeyed(twist.angular, limits.dead_zone_angular, limits.step_angular),
        )

    def _accelerated(self, aim: float, turn: float, dt: float) -> tuple[float, float]:
        """Return the wheels after ``dt`` on their way to ``aim`` and ``turn``."""
        limits, (linear, angular) = self.settings, self._wheels
        if aim == linear and turn == angular:
            return self._wheels
        turning = limits.angular_acceleration * dt
        return (
            self._faster(aim, linear, dt),
            angular + min(max(turn - angular, -turning), turning),
        )

    def _faster(self, aim: float, linear: float, dt: float) -> float:
        """Return the speed ``dt`` after ``linear``, on its way to ``aim``."""
        slower = abs(aim) < abs(linear) or aim * linear < 0.0
        change = self.settings.deceleration if slower else self.settings.acceleration
        return linear + min(max(aim - linear, -change * dt), change * dt)

    def _swivel(self, way: float) -> float:
        """Return the turn [rad] that casters add on ``way`` [m], ahead or back."""
        direction = math.copysign(1.0, way) if way else self._direction
        if direction == -self._direction and self.settings.caster_kick > 0.0:
            self._swivelled = 0.0
            self._kick = self.settings.caster_kick / SWIVEL_M * self._kicks.choice((-1.0, 1.0))
        self._direction = direction
        left = SWIVEL_M - self._swivelled
        if left <= 0.0:
            return 0.0
        self._swivelled += abs(way)
        return self._kick * min(abs(way), left)

    def _true(self, linear: float, angular: float) -> tuple[float, float]:
        """Return the true velocities of wheels that are unequal and slip."""
        settings = self.settings
        half, grip = 0.5 * settings.track, 1.0 - settings.slip
        ratio = math.sqrt(settings.wheel_ratio)
        left, right = (linear - half * angular) / ratio, (linear + half * angular) * ratio
        return grip * 0.5 * (left + right), grip * (right - left) / settings.track


def obeyed(speed: float, dead_zone: float, step: float) -> float:
    """Return the speed that motors make of ``speed``: none below ``dead_zone``, in steps."""
    if abs(speed) < dead_zone:
        return 0.0
    return step * round(speed / step) if step else speed
