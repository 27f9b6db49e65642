"""
Peers that are given the true pose, with the limits of the servo: what images cost.

``graceful`` is Nav2's graceful controller (Park and Kuipers, ICRA 2011) with its default gains
and slow-down; ``displaced`` drives a point off the axle, as section IX-1 of the paper remarks, and
knows no view; ``least_time`` a time-optimal unicycle: of all cubic curves from the start to the
goal that keep features in view, that which limits of speed, turn and acceleration allow to be
driven soonest.
"""

from collections.abc import Callable
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import HALF_PI, Pose, Twist
from visual_servo_epipolar.core.laws.smooth.steering import aim, curvature, Gains, polar_pose
from visual_servo_epipolar.core.servo.run_log import RunLog
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.evaluation.benchmarks.arrivals.peer_steps import as_step
from visual_servo_epipolar.simulation.closed_loop import Loop
from visual_servo_epipolar.simulation.run_monitor import LoopSettings
from visual_servo_epipolar.simulation.view import View

SLOWDOWN_M = 0.5  # slowdown_radius of Nav2 is 1.5 m, for 0.5 m/s and more
POINTS = 200  # of a curve
TANGENTS = np.geomspace(0.15, 4.0, 14)  # lengths of both ends' tangents, in distances
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
    while not loop.monitor.done:
        loop.decide_by(control)
        loop.record()
        loop.drive()
    return loop.monitor.log()


def least_time(start: Pose, settings: ServoSettings) -> float:
    """Return the least time of a smooth way ahead from ``start`` [s]; inf where there is none."""
    times = [
        _time(_curve(start, first, last), settings) for first in TANGENTS for last in TANGENTS
    ]
    return min(times)


def _curve(start: Pose, first: float, last: float) -> FloatArray:
    """Return a cubic curve to the goal, (N, 2), of tangents as long as told, in distances."""
    s = np.linspace(0.0, 1.0, POINTS)[:, None]
    begin = np.array([start.x, start.y])
    slope = first * start.distance * np.array([math.cos(start.theta), math.sin(start.theta)])
    end = last * start.distance * np.array([0.0, 1.0])
    return np.asarray(
        begin * (2 * s**3 - 3 * s**2 + 1) + slope * (s**3 - 2 * s**2 + s) + end * (s**3 - s**2)
    )


def _time(curve: FloatArray, settings: ServoSettings) -> float:
    """Return the least time of a ``curve`` within limits [s]; inf where it leaves the view."""
    steps = np.diff(curve, axis=0)
    ways = np.hypot(*steps.T)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])) - HALF_PI
    if np.abs(heading).max() > MOST_TURNED or (ways < 1e-9).any():
        return math.inf
    kappa = np.abs(np.diff(heading)) / (0.5 * (ways[1:] + ways[:-1]))
    speed = np.minimum(settings.max_linear, settings.max_angular / np.maximum(kappa, 1e-9))
    speed = np.concatenate([[0.0], speed, [0.0]])
    faster = settings.max_acceleration
    for k in range(1, len(speed)):
        speed[k] = min(speed[k], math.sqrt(speed[k - 1] ** 2 + 2.0 * faster * ways[k - 1]))
    for k in range(len(speed) - 2, -1, -1):
        speed[k] = min(speed[k], math.sqrt(speed[k + 1] ** 2 + 4.0 * faster * ways[k]))
    return float((2.0 * ways / (speed[1:] + speed[:-1])).sum())
