"""Simulated bases: a Pioneer, a car, dead reckoning of wheels, and a registry by name."""

from collections import deque
from collections.abc import Mapping
from dataclasses import astuple, dataclass
import math
from typing import Any, ClassVar, NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import (
    arc,
    integrate,
    motion_between,
    Pose,
    saturate,
    STANDSTILL,
    Twist,
    wrap_angle,
)
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.settings import internal, setting, Settings
from visual_servo_epipolar.core.stamps import NANOSECONDS

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

    def base(self, pose: Pose, *, seed: int, now_ns: int = 0) -> 'Pioneer':
        """Return the base at ``pose`` and time ``now_ns`` [ns]; ``seed`` fixes its noise."""
        return Pioneer(self, pose, seed=seed, now_ns=now_ns)


class Pioneer:
    """
    The base, advanced in simulated time [ns] by ``advance``; commands come in by ``command``.

    ``pose`` is ground truth, ``twist`` the true velocity, ``nodding`` the pitch of the body,
    ``odometry`` what the wheels report: it starts at (0, 0, 0) and drifts. A host may replace
    ``settings`` by others of one class while it drives.
    """

    def __init__(
        self, settings: PioneerSettings, pose: Pose, *, seed: int, now_ns: int = 0
    ) -> None:
        self.settings = settings
        self.pose = pose
        self.twist, self.nodding = STANDSTILL, LEVEL
        self.now_ns = now_ns
        self.wanted = STANDSTILL
        self.odometry = Pose(0.0, 0.0, 0.0)
        self._wheels = (0.0, 0.0)  # what the motors turn, as seen by nominal wheels
        self._pending: deque[tuple[int, Twist]] = deque()
        self._command_ns: int | None = None
        self._rng = np.random.default_rng((seed, 1))
        self._kicks = np.random.default_rng((seed, 9))
        self._kick = 0.0  # curvature of casters that swivel [1/m]
        self._swivelled, self._direction = SWIVEL_M, 0.0  # way since the reversal [m], its sign

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

    def advance(self, now_ns: int) -> None:
        """Move until ``now_ns``; a time that is not later moves nothing."""
        duration = (now_ns - self.now_ns) / NANOSECONDS
        if duration <= 0.0:
            return
        steps, start_ns = math.ceil(duration / SUBSTEP_S), self.now_ns
        dt, aim = duration / steps, self._limited(self.wanted)
        x, y, theta = self.pose.x, self.pose.y, self.pose.theta
        for number in range(1, steps + 1):
            if self._receive():
                aim = self._limited(self.wanted)
            before, self._wheels = self._wheels, self._accelerated(*aim, dt)
            if self.settings.nod > 0.0:
                faster = (self._wheels[0] - before[0]) / dt
                self.nodding = self.nodding.after(faster, dt, largest=self.settings.nod)
            twist = self._true(*self._wheels)
            if twist != (0.0, 0.0):
                x, y, theta = arc(x, y, theta, *twist, dt)
                theta += self._swivel(twist[0] * dt)
            self.odometry = integrate(self.odometry, self._measured(*self._wheels, dt), dt)
            self.now_ns = start_ns + (now_ns - start_ns) * number // steps
        self.pose, self.twist = Pose(x, y, theta), Twist(*twist)

    def _receive(self) -> bool:
        """Take what reaches the motors now; return whether that is another command."""
        before = self.wanted
        while self._pending and self._pending[0][0] <= self.now_ns:
            self.wanted = self._pending.popleft()[1]
        if self.timed_out:
            self.halt()
        return self.wanted != before

    def _measured(self, linear: float, angular: float, dt: float) -> Twist:
        """Return what wheels that turn so for ``dt`` report."""
        # A random walk: the variance grows with the way, so that the step does not matter.
        way, turn = abs(linear) * dt, abs(angular) * dt
        noise, (ahead, aside) = self.settings.odometry_noise, self._rng.standard_normal(2).tolist()
        return Twist(
            linear + noise * math.sqrt(way) * ahead / dt,
            angular + noise * math.sqrt(way + turn) * aside / dt,
        )

    def _limited(self, twist: Twist) -> tuple[float, float]:
        limits = self.settings
        twist = saturate(twist, max_linear=limits.max_linear, max_angular=limits.max_angular)
        return (
            obeyed(twist.linear, limits.dead_zone_linear, limits.step_linear),
            obeyed(twist.angular, limits.dead_zone_angular, limits.step_angular),
        )

    def _accelerated(self, aim: float, turn: float, dt: float) -> tuple[float, float]:
        """Return the wheels after ``dt`` on their way to ``aim`` and ``turn``."""
        linear, angular = self._wheels
        turning = self.settings.angular_acceleration * dt
        return self._faster(aim, linear, dt), angular + within(turn - angular, turning)

    def _faster(self, aim: float, linear: float, dt: float) -> float:
        """Return the speed ``dt`` after ``linear``, on its way to ``aim``."""
        slower = abs(aim) < abs(linear) or aim * linear < 0.0
        change = self.settings.deceleration if slower else self.settings.acceleration
        return linear + within(aim - linear, change * dt)

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


def within(value: float, most: float) -> float:
    """Return ``value``, or the nearest number that is as large as ``most``."""
    return min(max(value, -most), most)


def obeyed(speed: float, dead_zone: float, step: float) -> float:
    """Return the speed that motors make of ``speed``: none below ``dead_zone``, in steps."""
    if abs(speed) < dead_zone:
        return 0.0
    return step * round(speed / step) if step else speed


@dataclass(frozen=True, kw_only=True)
class AckermannSettings(PioneerSettings):
    """A car on the wheels of the Pioneer: what steers it; no wheel ratio, no turns of its own."""

    wheelbase: float = setting(0.33, 'Car: distance between both axles [m]', low=0.02, high=10.0)
    max_steering: float = setting(
        0.503, 'Car: largest angle of the steered wheels [rad]', low=0.01, high=1.5
    )
    steering_rate: float = setting(
        1.0, 'Car: how fast they are steered [rad/s]', low=0.01, high=50.0
    )
    GONE: ClassVar[Mapping[str, Any]] = {'steering_offset': 0.0}

    def base(self, pose: Pose, *, seed: int, now_ns: int = 0) -> 'Ackermann':
        """Return the car at ``pose`` and time ``now_ns`` [ns]."""
        return Ackermann(self, pose, seed=seed, now_ns=now_ns)


class Ackermann(Pioneer):
    """
    The base, as ``Pioneer``, but for its steering: the axle between the rear wheels is the robot.

    A twist steers by atan(wheelbase w / v), as drivers of such bases do: w without v steers as far
    as the wheels go and moves nothing, and a zero twist steers straight.
    """

    settings: AckermannSettings

    def __init__(
        self, settings: AckermannSettings, pose: Pose, *, seed: int, now_ns: int = 0
    ) -> None:
        super().__init__(settings, pose, seed=seed, now_ns=now_ns)
        self.steering = 0.0  # [rad], to the left

    def _limited(self, twist: Twist) -> tuple[float, float]:
        """Return the speed [m/s] and the steering angle [rad] that ``twist`` asks for."""
        limits = self.settings
        speed = within(twist.linear, limits.max_linear)
        speed = obeyed(speed, limits.dead_zone_linear, limits.step_linear)
        angle = 0.0
        if twist.linear:
            angle = math.atan(limits.wheelbase * twist.angular / twist.linear)
        elif twist.angular:
            angle = math.copysign(math.inf, twist.angular)
        return speed, within(angle, limits.max_steering)

    def _accelerated(self, aim: float, turn: float, dt: float) -> tuple[float, float]:
        self.steering += within(turn - self.steering, self.settings.steering_rate * dt)
        speed = self._faster(aim, self._wheels[0], dt)
        return speed, speed * math.tan(self.steering) / self.settings.wheelbase

    def _true(self, linear: float, angular: float) -> tuple[float, float]:
        settings = self.settings
        if linear == 0.0:
            return 0.0, 0.0
        grip = 1.0 - settings.slip
        angle = math.atan(settings.wheelbase * angular / linear)
        return grip * linear, grip * linear * math.tan(angle) / settings.wheelbase


# Settings of each base by its name; no two have a class in common.
SIMULATED_BASES: dict[str, type[PioneerSettings]] = {
    'pioneer': PioneerSettings,
    'ackermann': AckermannSettings,
}


@dataclass(frozen=True, slots=True)
class DeadReckoning:
    """
    Wheel odometry at one time: pose, mean velocity since ``dt`` [s] before, and how far it drove.

    ``way`` [m] and ``turn`` [rad] are those of all motion since the start, ahead or back.
    """

    pose: Pose
    now_ns: int
    twist: Twist = STANDSTILL
    dt: float = math.inf
    way: float = 0.0
    turn: float = 0.0

    def advanced(self, pose: Pose, now_ns: int) -> 'DeadReckoning':
        """Return the odometry at ``now_ns``, when wheels say ``pose``; before that, ``self``."""
        dt = (now_ns - self.now_ns) / NANOSECONDS
        if dt <= 0.0:
            return self
        way, turn = motion_between(self.pose, pose)
        total = self.way + abs(way), self.turn + abs(turn)
        return DeadReckoning(pose, now_ns, Twist(way / dt, turn / dt), dt, *total)

    def variances(self, noise: float) -> tuple[FloatArray, FloatArray]:
        """
        Return those of x, y and theta, (3,), and of linear and angular velocity, (2,).

        ``noise`` is the deviation of the way after a metre, and of the heading after a metre and
        after a radian: both are random walks. The place errs as it does aside of a straight way.
        """
        heading, (linear, angular) = self.way + self.turn, np.abs(astuple(self.twist))
        place = self.way + self.way**2 * heading / 3.0
        speeds = np.array([linear, linear + angular]) / self.dt
        return noise**2 * np.array([place, place, heading]), noise**2 * speeds


def world_to_odometry(truth: Pose, odometry: Pose) -> Pose:
    """Return the pose of the odometry's frame in the world: where the wheels think they began."""
    turn = truth.theta - odometry.theta
    sin, cos = math.sin(turn), math.cos(turn)
    return Pose(
        truth.x - cos * odometry.x + sin * odometry.y,
        truth.y - sin * odometry.x - cos * odometry.y,
        wrap_angle(turn),
    )
