"""
The paper's two-step law in continuous time, as in its simulations (section VII).

The camera sees eight points. Every stage of the integration projects them anew, estimates F, takes
the epipoles and asks ``core.laws``, the functions that the robot runs, for the velocities.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
import math
from operator import attrgetter
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.cheirality import oriented_bearings
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import (
    DESIRED_POSE,
    HALF_PI,
    integrate,
    Pose,
    Twist,
)
from visual_servo_epipolar.core.geometry.rays import unit_rays
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.twoview.lmeds_8pt import fundamental_from_matches
from visual_servo_epipolar.evaluation.reproduction.paper import Decay, decay

# (X, Y, Z) in the axes of the desired camera: right, down, forward [m]. The paper does not say
# where its points are. These lie ahead of every pose of both simulations and span the view.
POINTS = (
    *((-4.2, -3.1, 8.4), (-2.6, 2.4, 6.3), (-3.3, -0.9, 7.1), (-0.8, 3.6, 9.2)),
    *((-1.1, -3.8, 6.7), (0.9, 1.7, 7.6), (1.6, -3.2, 7.4), (2.3, 2.9, 8.9)),
)
RAY_NOISE = 1e-6  # only scales the cheirality vote: the points are exact


@dataclass(frozen=True, slots=True)
class EpipoleReading:
    """Epipole abscissae e_au and e_du [m], and the sign of cos(psi - theta) by cheirality."""

    e_current: float
    e_desired: float
    sigma: float


class PointCamera:
    """
    A pinhole camera before POINTS: images in metres, as in the paper (k_u = k_v = 1, eq. 2).

    ``focal`` is the true focal length f [m], ``focal_guess`` f_hat [m], by which image points are
    divided to make rays: only sigma depends on it.
    """

    def __init__(self, focal: float, focal_guess: float) -> None:
        self.focal, self.focal_guess = focal, focal_guess
        self.points = np.array(POINTS)
        self.desired = self.image(DESIRED_POSE)

    def image(self, pose: Pose) -> FloatArray:
        """Return the image points from ``pose``, shape (N, 2) [m]; behind the camera nan."""
        alpha = pose.heading_error
        cosine, sine = math.cos(alpha), math.sin(alpha)
        x, z = self.points[:, 0] - pose.x, self.points[:, 2] - pose.y
        right, forward = cosine * x + sine * z, -sine * x + cosine * z
        forward = np.where(forward > 0.0, forward, math.nan)
        return np.asarray(
            np.stack([right, self.points[:, 1]], axis=1) * (self.focal / forward)[:, None]
        )

    def read(self, pose: Pose) -> EpipoleReading:
        """
        Return the epipoles at ``pose``, by the 8-point algorithm (eq. 3).

        DegenerateGeometryError at the goal itself, ValueError where a point is out of view.
        """
        current = self.image(pose) / self.focal_guess
        desired = self.desired / self.focal_guess
        fundamental = fundamental_from_matches(current, desired)
        rays = unit_rays(current), unit_rays(desired)
        bearings = oriented_bearings(fundamental, *rays, noise=RAY_NOISE).bearings
        return EpipoleReading(
            self.focal_guess * bearings.epipole_current,
            self.focal_guess * bearings.epipole_desired,
            bearings.sigma,
        )


GRADING = 0.02  # of the remaining time until e_du = 0: there the law is not Lipschitz
LONGEST_STEP_S = 0.01  # before e_du is zero
ROTATION_STEP_S = 0.05
TRANSLATION_STEP_S = 1.0
LONGEST_RUN_S = 5000.0
FARTHEST_M = 100.0

State = FloatArray  # x, y [m], theta [rad], d_hat [m]


@dataclass(frozen=True, kw_only=True)
class Case:
    """
    One simulation: the parameters of section VII. Lengths in m, angles in rad.

    ``sign`` is the sigma of the law: 'printed' sign(e_au e_du), 'cheirality' the vote of the
    points at every instant, 'held' their vote at the start. A step ends where epipoles [m] or |D|
    [m^2] are within the ``tolerance``.
    """

    name: str
    focal: float = 0.03
    focal_guess: float = 0.03
    start: Pose = field(default_factory=lambda: Pose(1.0, 1.0, HALF_PI))
    k1: float = 0.5
    k2: float = 0.5
    exponent: float = 5.0 / 9.0
    initial_distance: float = 2.0
    k_t: float = 100.0
    tolerance: float = 1e-9
    sign: str = 'printed'


@dataclass(frozen=True, slots=True)
class Instant:
    """State, epipoles and twist at one time [s]; ``step`` is 1 or 2, D in m^2, d_hat in m."""

    time: float
    pose: Pose
    distance_estimate: float
    reading: EpipoleReading
    twist: Twist
    difference: float
    step: int


@dataclass(frozen=True, slots=True)
class Course:
    """A whole run: its instants, when e_du became zero [s], and how it ended."""

    case: Case
    instants: tuple[Instant, ...]
    zeroed_at: float
    outcome: str

    def column(self, name: str, step: int | None = None) -> FloatArray:
        """Return an attribute, as 'pose.x', of all instants or those of one step, shape (N,)."""
        take = attrgetter(name)
        return np.array([take(i) for i in self.instants if step in (None, i.step)])


class Simulation:
    """Runs one ``Case``; ``course`` is the answer."""

    def __init__(self, case: Case) -> None:
        self.case, self.camera = case, PointCamera(case.focal, case.focal_guess)
        self._held = self.camera.read(case.start).sigma
        self._zeroed = False

    def course(self) -> Course:
        """Drive both steps and return what happened."""
        start = self.case.start
        state = np.array([start.x, start.y, start.theta, self.case.initial_distance])
        instants, zeroed_at = [self.first(0.0, state)], math.nan
        try:
            outcome = self._transient(instants)
            if not outcome:
                zeroed_at = instants[-1].time + self._time_to_zero(instants[-1])
                self._rotate(instants)
                outcome = self._translate(instants)
        except ValueError:
            outcome = 'a point left the half-space before the camera'
        return Course(self.case, tuple(instants), zeroed_at, outcome)

    def _transient(self, instants: list[Instant]) -> str:
        """Integrate until e_du counts as zero; return why it failed, if it did."""
        side = math.copysign(1.0, instants[0].reading.e_desired)
        while instants[-1].reading.e_desired * side > self.case.tolerance:
            now = instants[-1]
            step = min(GRADING * self._time_to_zero(now), LONGEST_STEP_S)
            instants.append(self._after(now, step, self.first))
            if instants[-1].pose.distance > FARTHEST_M or not step > 0.0:
                return f'diverged, {instants[-1].pose.distance:.0f} m from the goal'
            if now.reading.e_current * instants[-1].reading.e_current < 0.0:
                far = abs(now.reading.e_current) > self.case.focal
                return f'e_au passed through {"infinity" if far else "zero"}'
        return ''

    def _rotate(self, instants: list[Instant]) -> None:
        """Turn in place until e_au is within the tolerance: u_1 is zero with e_du."""
        self._zeroed = True
        instants.append(self.first(instants[-1].time, _state(instants[-1])))
        while abs(instants[-1].reading.e_current) > self.case.tolerance:
            instants.append(self._after(instants[-1], ROTATION_STEP_S, self.first))

    def _translate(self, instants: list[Instant]) -> str:
        """Drive straight until the features match (21)."""
        instants.append(self._second(instants[-1].time, _state(instants[-1])))
        while abs(instants[-1].difference) > self.case.tolerance:
            instants.append(self._after(instants[-1], TRANSLATION_STEP_S, self._second))
            if instants[-1].time > LONGEST_RUN_S:
                return f'not there after {LONGEST_RUN_S:.0f} s'
        return 'arrived'

    def _after(self, now: Instant, dt: float, at: Callable[[float, State], Instant]) -> Instant:
        """Return the instant ``dt`` later, by the classical Runge-Kutta method of order four."""

        def slope(offset: float, state: State) -> State:
            return self.rate(at(now.time + offset, state))

        state = _state(now)
        k_1 = self.rate(now)
        k_2 = slope(0.5 * dt, state + 0.5 * dt * k_1)
        k_3 = slope(0.5 * dt, state + 0.5 * dt * k_2)
        k_4 = slope(dt, state + dt * k_3)
        return at(now.time + dt, state + dt / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4))

    def rate(self, now: Instant) -> State:
        """Return the derivative of the state: the unicycle (4), and d_hat (13), (25)."""
        theta, twist, reading = now.pose.theta, now.twist, now.reading
        growth = equations.distance_rate(
            twist.linear,
            reading.e_current,
            sigma=self._sigma(reading),
            focal=self.case.focal_guess,
        )
        return np.array(
            [
                twist.linear * math.cos(theta),
                twist.linear * math.sin(theta),
                twist.angular,
                growth if now.step == 1 else 0.0,
            ]
        )

    def first(self, time: float, state: State) -> Instant:
        """Return the first step at ``time`` [s] and ``state``: eqs. (12), (16), (17)."""
        case, pose = self.case, Pose(*state[:3].tolist())
        reading, image = self.camera.read(pose), self.camera.image(pose)
        nu_1, nu_2 = equations.auxiliary_controls(
            reading.e_current, reading.e_desired, k1=case.k1, k2=case.k2, exponent=case.exponent
        )
        twist = equations.linearizing_control(
            reading.e_current,
            reading.e_desired,
            sigma=self._sigma(reading),
            distance=float(state[3]),
            nu=(nu_1, 0.0 if self._zeroed else nu_2),
            focal=case.focal_guess,
        )
        difference = self._difference(image)
        return Instant(time, pose, float(state[3]), reading, twist, difference, 1)

    def _second(self, time: float, state: State) -> Instant:
        """Return the second step at ``state``: eqs. (21), (22); it asks for no epipoles."""
        pose = Pose(*state[:3].tolist())
        difference = self._difference(self.camera.image(pose))
        twist = equations.match_features(difference, k_t=self.case.k_t)
        reading = EpipoleReading(math.nan, math.nan, math.nan)
        return Instant(time, pose, float(state[3]), reading, twist, difference, 2)

    def _difference(self, image: FloatArray) -> float:
        """Return D [m^2] of image points, shape (N, 2) [m]: eq. (23)."""
        squares = (image**2).sum(axis=1) - (self.camera.desired**2).sum(axis=1)
        return float(squares.mean())

    def _sigma(self, reading: EpipoleReading) -> float:
        if self.case.sign == 'printed':
            return equations.printed_sigma(reading.e_current, reading.e_desired)
        return self._held if self.case.sign == 'held' else reading.sigma

    def _time_to_zero(self, now: Instant) -> float:
        """Return the time until e_du = 0 [s] if d_hat / d stayed as it is: (15) in closed form."""
        _, rate = equations.epipole_rates(
            now.twist,
            now.reading.e_current,
            now.reading.e_desired,
            sigma=Bearings.from_pose(now.pose).sigma,
            distance=now.pose.distance,
            focal=self.case.focal,
        )
        closing = -rate * math.copysign(1.0, now.reading.e_desired)
        if not closing > 0.0:
            return LONGEST_STEP_S / GRADING  # e_du runs away: no end to step towards
        return abs(now.reading.e_desired) / ((1.0 - self.case.exponent) * closing)


def _state(now: Instant) -> State:
    return np.array([now.pose.x, now.pose.y, now.pose.theta, now.distance_estimate])


def run(case: Case) -> Course:
    """Return the course of ``case``."""
    return Simulation(case).course()


SIMULATION_1 = Case(name='Simulation 1')
SIMULATION_2 = Case(name='Simulation 2', focal_guess=0.005)
BEHIND = Pose(1.0, -1.0, HALF_PI)  # the mirror image of the paper's start, behind the goal
PERIOD_S = 0.01  # the sampling under which the printed sign is tried


@dataclass(frozen=True, slots=True)
class Simulation1:
    """Simulation 1 under the printed and the corrected sign: continuous, sampled, from behind."""

    course: Course
    corrected: Course
    behind_printed: Course
    behind_corrected: Course
    sampled_printed: tuple[Instant, ...]
    sampled_corrected: tuple[Instant, ...]


@dataclass(frozen=True, slots=True)
class Simulation2:
    """Simulation 2 under the printed sign, the sign held, and the sign voted with f_hat."""

    course: Course
    held: Course
    voted: Course


def simulation_1() -> Simulation1:
    """Run simulation 1 in all its variants."""
    corrected = replace(SIMULATION_1, sign='cheirality')
    return Simulation1(
        course=run(SIMULATION_1),
        corrected=run(corrected),
        behind_printed=run(replace(SIMULATION_1, start=BEHIND)),
        behind_corrected=run(replace(corrected, start=BEHIND)),
        sampled_printed=sample_first_step(SIMULATION_1, PERIOD_S, 20.0),
        sampled_corrected=sample_first_step(corrected, PERIOD_S, 20.0),
    )


def simulation_2() -> Simulation2:
    """Run simulation 2 in all its variants."""
    return Simulation2(
        course=run(SIMULATION_2),
        held=run(replace(SIMULATION_2, sign='held')),
        voted=run(replace(SIMULATION_2, sign='cheirality')),
    )


def longest_transient(case: Case, e_desired: float) -> float:
    """Return the bound on the time at which e_du is zero [s], d_hat >= d (section IV-C 1)."""
    power = 1.0 - case.exponent
    return float(abs(e_desired) ** power / (case.k2 * power))


def rotation_decay(course: Course) -> Decay:
    """Return the decay of e_au once e_du is zero, fitted to its last quarter."""
    time, values = course.column('time', 1), course.column('reading.e_current', 1)
    rows = time > time[-1] - 0.25 * (time[-1] - course.zeroed_at)
    return decay(time[rows], values[rows])


def translation_decay(course: Course, name: str) -> Decay:
    """Return the decay of a quantity in the second half of the second step."""
    time, values = course.column('time', 2), course.column(name, 2)
    half = len(time) // 2
    return decay(time[half:], values[half:])


def rate_at_goal(case: Case) -> float:
    """Return k_t alpha of (23) at the goal [1/s]: what d and D decay by in the end."""
    points = PointCamera(case.focal, case.focal_guess).points
    alpha = 2.0 * case.focal**2 * (points[:, :2] ** 2).sum(axis=1) / points[:, 2] ** 3
    return case.k_t * float(alpha.mean())


def growth_ratio(course: Course) -> FloatArray:
    """Return mu = d' / d_hat' of (29) along the transient, shape (N,), by (25) and (28)."""
    case, e_current = course.case, course.column('reading.e_current', 1)
    rows = course.column('time', 1) < course.zeroed_at
    squares = np.hypot(e_current[rows], case.focal_guess) / np.hypot(e_current[rows], case.focal)
    return np.asarray(case.focal / case.focal_guess * squares)


def largest_gap(one: Course, other: Course) -> float:
    """Return the largest distance between two courses at equal times [m]."""
    time = one.column('time')
    x, y = (
        np.interp(time, other.column('time'), other.column(name)) for name in ('pose.x', 'pose.y')
    )
    return float(np.hypot(one.column('pose.x') - x, one.column('pose.y') - y).max())


def metrics(course: Course) -> Mapping[str, Any]:
    """Return the metrics of a course as JSON has them."""
    last = [instant for instant in course.instants if instant.step == 1][-1]
    values: dict[str, Any] = {
        'sign': course.case.sign,
        'outcome': course.outcome,
        'e_desired_zero_s': course.zeroed_at,
        'first_step_s': last.time,
        'intermediate_pose': [last.pose.x, last.pose.y, math.degrees(last.pose.heading_error)],
        'e_current_min_m': float(np.abs(transient(course, 'reading.e_current')).min()),
        'linear_max_m_s': float(np.abs(course.column('twist.linear', 1)).max()),
        'angular_max_rad_s': float(np.abs(course.column('twist.angular', 1)).max()),
    }
    if course.outcome == 'arrived':
        values |= {
            'e_current_rate_per_s': rotation_decay(course).rate,
            'distance_rate_per_s': translation_decay(course, 'pose.distance').rate,
            'difference_rate_per_s': translation_decay(course, 'difference').rate,
            'final_distance_m': course.instants[-1].pose.distance,
            'duration_s': course.instants[-1].time,
        }
    return values


def transient(course: Course, name: str) -> FloatArray:
    """Return one quantity, shape (N,), until e_du counts as zero, or all of the first step."""
    zero = np.abs(course.column('reading.e_desired', 1)) <= course.case.tolerance
    count = int(np.argmax(zero)) + 1 if zero.any() else len(zero)
    return np.asarray(course.column(name, 1)[:count])


def sample_first_step(case: Case, period: float, duration: float) -> tuple[Instant, ...]:
    """
    Return the first step of ``case`` with a new command every ``period`` for ``duration`` [s].

    The law is the bare one: no latch, no saturation. It ends early when a point is out of view.
    """
    simulation = Simulation(case)
    pose, distance = case.start, case.initial_distance
    instants: list[Instant] = []
    while not instants or instants[-1].time < duration:
        state = np.array([pose.x, pose.y, pose.theta, distance])
        try:
            now = simulation.first(period * len(instants), state)
        except ValueError:
            break
        instants.append(now)
        pose = integrate(pose, now.twist, period)
        distance += period * float(simulation.rate(now)[3])
    return tuple(instants)
