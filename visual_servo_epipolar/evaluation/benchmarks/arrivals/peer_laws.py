"""
Peer laws: position-based, homography-based and image-based visual servoing of a unicycle.

Position-based: the polar law of Aicardi, Casalino, Bicchi, Balestrino (1995) on the relative pose.
With e the distance, a the direction of the goal against the heading and b against the goal's
heading, u = g cos(a) e and w = k a + g cos(a) sin(a) / a (a + h b) make (e^2 + a^2 + h b^2) / 2
fall. It is smooth, and knows no field of view. Close to the goal, where the direction of the
residual is noise, the robot covers the way ahead and turns to the final heading.

Homography-based: after Fang, Dixon, Dawson, Chawda, IEEE SMC-B 35(5), 2005. Scaled translation and
rotation, as a homography gives them, are the errors: e1 and e2 the goal's place in the robot's
frame over the depth d* of the plane, e3 the heading error. A turn that never rests, e2^2 sin t,
moves what no smooth law that knows no time can: e2. With

    v = k_v e1,  w = -k_w e3 + k_s |e2| e2 sin(s t)

(e1^2 + e2^2)' = -2 k_v e1^2 / d*, so that e1 goes to zero, e2 w too, and then e2 and e3. This form
needs no estimate of d*, and turns to the goal's side first, which loses fewer features. As in the
original convergence is not exponential: the turn fades with e2.

Image-based: the classical law on points (Espiau, Chaumette, Rives 1992). The interaction matrix
keeps the columns of v and w alone, at the depth of the scene from the goal:
x' = x v / Z + (1 + x^2) w and y' = y v / Z + x y w for a ray (x, y). The robot cannot do what the
image asks sideways: where the error has no part along the two columns it stands still.
"""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import Twist, wrap_angle
from visual_servo_epipolar.core.settings import setting, Settings
from visual_servo_epipolar.evaluation.benchmarks.arrivals.pose_measurement import RelativePose


@dataclass(frozen=True, kw_only=True)
class PolarGains(Settings):
    """Gains of the polar law, and the depth that it takes for the scene's."""

    depth: float = setting(5.0, 'Depth Z of the scene from the goal [m]', low=0.1, high=100.0)
    close: float = setting(0.05, 'Distance at which directions are noise [m]', low=0.0, high=1.0)
    approach: float = setting(0.3, 'Gain g of the distance [1/s]', low=0.01, high=5.0)
    turn: float = setting(1.0, 'Gain k of the direction [1/s]', low=0.01, high=5.0)
    align: float = setting(1.5, 'Weight h of the final heading', low=0.01, high=20.0)


def polar(pose: RelativePose, gains: PolarGains, *, backwards: bool = False) -> Twist:
    """Return the twist of the polar law; ``backwards`` drives it with the robot's other end."""
    if pose.distance * gains.depth < gains.close:
        ahead = gains.approach * pose.ahead * gains.depth
        return Twist(ahead, -gains.turn * pose.heading_error)
    half_turn = math.pi if backwards else 0.0
    toward = pose.psi + math.pi - half_turn  # the direction in which that end has to go
    against_goal = wrap_angle(toward - 0.5 * math.pi)
    against_heading = wrap_angle(against_goal - pose.heading_error)
    cosine = math.cos(against_heading)
    sinc = math.sin(against_heading) / against_heading if against_heading else 1.0
    pull = gains.approach * cosine * sinc * (against_heading + gains.align * against_goal)
    speed = gains.approach * cosine * pose.distance * gains.depth
    return Twist(-speed if backwards else speed, gains.turn * against_heading + pull)


def is_behind(pose: RelativePose) -> bool:
    """Return whether the goal lies behind the robot, so that it is to be reached backwards."""
    return pose.ahead < 0.0


@dataclass(frozen=True, kw_only=True)
class TurningGains(Settings):
    """Gains of the law that never rests."""

    forward: float = setting(2.0, 'Gain k_v of e1 [m/s]', low=0.01, high=20.0)
    heading: float = setting(0.2, 'Gain k_w of e3 [1/s]', low=0.01, high=5.0)
    search: float = setting(10.0, 'Gain k_s of the turn that never rests [1/s]', low=0.0, high=1e3)
    pace: float = setting(0.4, 'Its angular frequency s [rad/s]', low=0.01, high=5.0)


def never_resting(pose: RelativePose, gains: TurningGains, *, elapsed: float) -> Twist:
    """Return the twist at ``elapsed`` [s] from the start."""
    turn = gains.search * abs(pose.left) * pose.left * math.sin(gains.pace * elapsed)
    return Twist(gains.forward * pose.ahead, turn - gains.heading * pose.heading_error)


@dataclass(frozen=True, kw_only=True)
class PointGains(Settings):
    """Gain of the classical law, and the depth that it takes for every point's."""

    depth: float = setting(5.0, 'Depth Z of the points from the goal [m]', low=0.1, high=100.0)
    gain: float = setting(0.3, 'Gain lambda [1/s]', low=0.01, high=5.0)


def points(current: FloatArray, desired: FloatArray, gains: PointGains) -> Twist:
    """Return -lambda L^+ (s - s*) for rays, shape (N, 2) each."""
    x, y = current.T
    forward = np.concatenate([x, y]) / gains.depth
    turn = np.concatenate([1.0 + x * x, x * y])
    matrix = np.stack([forward, turn], axis=1)
    error = (current - desired).T.reshape(-1)
    linear, angular = -gains.gain * np.linalg.lstsq(matrix, error, rcond=None)[0]
    return Twist(float(linear), float(angular))
