"""Simulations 1 and 2 of the paper (section VII): runs under each sign, and their metrics."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import HALF_PI, integrate, Pose
from visual_servo_epipolar.evaluation.reproduction.simulations.continuous import (
    Case,
    Course,
    Instant,
    PointCamera,
    run,
    Simulation,
)
from visual_servo_epipolar.evaluation.reproduction.statements import Decay, decay

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
