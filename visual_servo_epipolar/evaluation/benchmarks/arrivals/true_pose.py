"""
Peers that are given the true pose, with the limits of the servo: what images cost.

``graceful`` is Nav2's graceful controller (Park and Kuipers, ICRA 2011) with its default gains
and slow-down; ``displaced`` drives a point off the axle, as section IX-1 of the paper remarks, and
knows no view; ``least_time`` a time-optimal unicycle: of all cubic curves to the goal that keep
features in view, from the start or after an arc back, that which limits of speed, turn and
acceleration allow to be driven soonest.
"""

from collections.abc import Callable
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import HALF_PI, Pose, Twist
from visual_servo_epipolar.core.laws.smooth.arcs import GoalOffset, moved
from visual_servo_epipolar.core.laws.smooth.steering import aim, curvature, Gains, polar_pose
from visual_servo_epipolar.core.servo.run_log import MotionLimits, RunLog
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.evaluation.benchmarks.arrivals.peers import as_step
from visual_servo_epipolar.simulation.closed_loop import Loop
from visual_servo_epipolar.simulation.run_monitor import LoopSettings
from visual_servo_epipolar.simulation.view import View

SLOWDOWN_M = 0.5  # slowdown_radius of Nav2 is 1.5 m, for 0.5 m/s and more
POINTS = 200  # of a curve
TANGENTS = np.geomspace(0.15, 4.0, 14)  # lengths of both ends' tangents, in distances
BACK = np.array([0.0, 0.1, 0.2, 0.3, 0.45, 0.6, 0.8, 1.0, 1.4, 2.0, 2.8, 4.0])  # ways back [m]
BENDS = np.array([-1.0, -0.5, 0.0, 0.5, 1.0])  # of a way back [1/m]
MOST_TURNED = 0.7  # heading error at which features are still in view [rad]
GAINS = Gains(2.0, 1.0)  # k_phi and k_delta of nav2_graceful_controller by default
BETA, LAMBDA = 0.4, 2.0  # likewise
OFF_AXLE = 0.2  # of the point that ``displaced`` drives, ahead [m]


def graceful(pose: Pose, settings: ServoSettings) -> Twist:
    """Return the velocity of Nav2's graceful controller at ``pose``."""
    at = polar_pose(pose.x, pose.y, pose.heading_error)
    if at.distance == 0.0:
        return Twist(0.0, 0.0)
    kappa = curvature(at, GAINS)
    slow = 1.0 + BETA * abs(kappa) ** LAMBDA
    speed = settings.max_linear * min(1.0 / slow, at.distance / SLOWDOWN_M)
    speed = min(speed, settings.max_angular / max(abs(kappa), 1e-9))
    return Twist(speed, kappa * speed)


def displaced(pose: Pose, settings: ServoSettings) -> Twist:
    """
    Return the velocity that drives a point OFF_AXLE ahead of the axle in any direction, at once.

    Its velocity is (v, OFF_AXLE w) in the robot's axes. The direction is the one that law smooth
    turns to; the heading follows it like a trailer, within a few OFF_AXLE of way.
    """
    sin, cos = math.sin(pose.heading_error), math.cos(pose.heading_error)
    at = polar_pose(pose.x - OFF_AXLE * sin, pose.y + OFF_AXLE * (cos - 1.0), pose.heading_error)
    speed = settings.max_linear * min(1.0, at.distance / SLOWDOWN_M)
    off = math.remainder(aim(at.phi, Gains()) - at.delta, math.tau)
    return Twist(speed * math.cos(off), speed * math.sin(off) / OFF_AXLE)


PoseLaw = Callable[[Pose, ServoSettings], Twist]
POSE_LAWS: dict[str, PoseLaw] = {'graceful': graceful, 'displaced': displaced}


def drive_by_pose(name: str, settings: LoopSettings, view: View, camera: CameraModel) -> RunLog:
    """Drive by a law of POSE_LAWS until the features match, and return the record."""
    loop, law = Loop(settings, view, camera), POSE_LAWS[name]
    control = as_step(lambda *_: law(loop.pose, settings.servo))
    return loop.run(control=control)


def least_time(start: Pose, settings: ServoSettings) -> float:
    """
    Return the least time of a way ahead, after an arc back where that is sooner [s].

    inf where there is none. It backs off at ``retreat_speed``, and stands at the cusp.
    """
    back, bend = (each.ravel() for each in np.meshgrid(BACK, BENDS))
    behind = moved(
        GoalOffset(*(np.full(len(back), it) for it in (start.x, start.y, start.heading_error))),
        -back,
        bend,
    )
    limits = MotionLimits.of(settings, backward=settings.retreat_speed)
    before = np.array([limits.time(way, limits.backward) for way in back])
    ahead = behind.y < 0.0
    ways = [
        _curves(GoalOffset(*(it[ahead] for it in behind)), first, last)
        for first in TANGENTS
        for last in TANGENTS
    ]
    return min(
        float((before[ahead] + _times(way, settings)).min(initial=math.inf)) for way in ways
    )


def _curves(start: GoalOffset, first: float, last: float) -> FloatArray:
    """Return cubic curves to the goal, (N, POINTS, 2), tangents as long as told, in distances."""
    s = np.linspace(0.0, 1.0, POINTS)[:, None]
    distance = np.hypot(start.x, start.y)[:, None]
    begin = np.stack([start.x, start.y], axis=1)[:, None]
    slope = first * distance * np.stack([-np.sin(start.heading), np.cos(start.heading)], axis=1)
    end = last * distance * np.array([0.0, 1.0])
    return np.asarray(
        begin * (2 * s**3 - 3 * s**2 + 1)
        + slope[:, None] * (s**3 - 2 * s**2 + s)
        + end[:, None] * (s**3 - s**2)
    )


def _times(curves: FloatArray, settings: ServoSettings) -> FloatArray:
    """Return the least times of ``curves`` within limits [s]; inf where one leaves the view."""
    steps = np.diff(curves, axis=1)
    ways = np.hypot(steps[..., 0], steps[..., 1])
    heading = np.unwrap(np.arctan2(steps[..., 1], steps[..., 0]), axis=1) - HALF_PI
    out = (np.abs(heading).max(axis=1) > MOST_TURNED) | (ways < 1e-9).any(axis=1)
    kappa = np.abs(np.diff(heading, axis=1)) / np.maximum(0.5 * (ways[:, 1:] + ways[:, :-1]), 1e-9)
    speed = np.minimum(settings.max_linear, settings.max_angular / np.maximum(kappa, 1e-9))
    speed = np.pad(speed, ((0, 0), (1, 1)))
    gains = 2.0 * settings.max_acceleration * ways  # of the squared speed
    for k in range(1, speed.shape[1]):
        speed[:, k] = np.minimum(speed[:, k], np.sqrt(speed[:, k - 1] ** 2 + gains[:, k - 1]))
    for k in range(speed.shape[1] - 2, -1, -1):
        speed[:, k] = np.minimum(speed[:, k], np.sqrt(speed[:, k + 1] ** 2 + 2.0 * gains[:, k]))
    times = (2.0 * ways / np.maximum(speed[:, 1:] + speed[:, :-1], 1e-12)).sum(axis=1)
    return np.where(out, np.inf, times)
