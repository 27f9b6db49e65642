"""Runs of the first step, integrated to the solver's accuracy: what theory is held against."""

from collections.abc import Callable
from dataclasses import dataclass
import math

import numpy as np
from scipy.integrate import solve_ivp
from strategies import pose_with

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.laws import equations

RESIDUE = 1e-4  # of e_du, where a run stops: past it the law is not Lipschitz


@dataclass(frozen=True, kw_only=True)
class Start:
    """Where a run begins: epipoles at unit focal length, sigma, d_0 [m], d_hat_0 / d_0."""

    e_current: float
    e_desired: float
    sigma: float = -1.0
    distance: float = 1.0
    ratio: float = 1.0
    ahead: bool = False

    @property
    def pose(self) -> Pose:
        return pose_with(
            self.e_current,
            self.e_desired,
            sigma=self.sigma,
            distance=self.distance,
            ahead=self.ahead,
        )


@dataclass(frozen=True, kw_only=True)
class Law:
    """What drives: gains, f_hat at f = 1, (12) or (20), the true sigma or the printed one."""

    k1: float = 0.1
    k2: float = 0.5
    exponent: float = 5.0 / 9.0
    guess: float = 1.0
    finite: bool = False
    printed: bool = False

    def nu(self, e_current: float, e_desired: float) -> tuple[float, float]:
        rule = equations.finite_time_controls if self.finite else equations.auxiliary_controls
        return rule(e_current, e_desired, k1=self.k1, k2=self.k2, exponent=self.exponent)

    def twist(self, bearings: Bearings, estimate: float) -> Twist:
        e_current, e_desired = bearings.epipole_current, bearings.epipole_desired
        sigma = equations.printed_sigma(e_current, e_desired) if self.printed else bearings.sigma
        return equations.linearizing_control(
            e_current,
            e_desired,
            sigma=sigma,
            distance=estimate,
            nu=self.nu(e_current, e_desired),
            focal=self.guess,
        )


@dataclass(frozen=True)
class Drive:
    """A run: times (N,), states (5, N) x, y, theta, d_hat, integral of cos^2; how it ended."""

    times: np.ndarray
    states: np.ndarray
    ended: str  # 'zeroed', 'infinite' (e_au), 'singular' or 'time'
    law: Law

    @property
    def distance(self) -> np.ndarray:
        return np.hypot(self.states[0], self.states[1])

    @property
    def estimate(self) -> np.ndarray:
        return self.states[3]

    @property
    def alpha(self) -> np.ndarray:
        """theta - psi, continuous [rad]."""
        return np.unwrap(self.states[2] - np.arctan2(self.states[1], self.states[0]))

    @property
    def e_current(self) -> np.ndarray:
        return np.tan(self.alpha)

    @property
    def e_desired(self) -> np.ndarray:
        return self.states[0] / self.states[1]

    def rates(self) -> np.ndarray:
        """Return the rates (5, N) of the states."""
        return np.array([rates(self.law)(0.0, q) for q in self.states.T]).T


def rates(law: Law) -> Callable[[float, np.ndarray], list[float]]:
    """Return the right-hand side of (4) and (13) or (25), closed by ``law``."""

    def side(_: float, q: np.ndarray) -> list[float]:
        bearings = Bearings.from_pose(Pose(*q[:3]))
        twist = law.twist(bearings, q[3])
        e_current = bearings.epipole_current
        sigma = bearings.sigma
        if law.printed:  # (13) as printed holds no sigma: it takes the signs to agree
            sigma = equations.printed_sigma(e_current, bearings.epipole_desired)
        return [
            twist.linear * math.cos(q[2]),
            twist.linear * math.sin(q[2]),
            twist.angular,
            equations.distance_rate(twist.linear, e_current, sigma=sigma, focal=law.guess),
            law.guess / (e_current**2 + law.guess**2),
        ]

    return side


def drive(start: Start, law: Law, *, duration: float = 1e4, count: int = 40) -> Drive:
    """Integrate until e_du is zeroed, e_au passes infinity or zero, or time runs out."""

    def zeroed(_: float, q: np.ndarray) -> float:
        return abs(q[0] / q[1]) - RESIDUE

    def infinite(_: float, q: np.ndarray) -> float:
        return math.cos(q[2] - math.atan2(q[1], q[0]))

    def singular(_: float, q: np.ndarray) -> float:
        return abs(math.sin(q[2] - math.atan2(q[1], q[0]))) - 1e-7

    events = [zeroed, infinite, singular]
    for event in events:
        event.terminal = True  # type: ignore[attr-defined]
    pose = start.pose
    q = [pose.x, pose.y, pose.theta, start.ratio * start.distance, 0.0]
    solution = solve_ivp(
        rates(law),
        (0.0, duration),
        q,
        'DOP853',
        events=events,
        rtol=1e-10,
        atol=1e-12,
        dense_output=True,
    )
    assert solution.success, solution.message
    names = ('zeroed', 'infinite', 'singular')
    ends = zip(names, solution.t_events, strict=True)
    ended = next((name for name, hits in ends if hits.size), 'time')
    times = np.linspace(0.0, solution.t[-1], count)
    return Drive(times, solution.sol(times), ended, law)
