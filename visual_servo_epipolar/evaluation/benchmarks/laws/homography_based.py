"""
Homography-based: after Fang, Dixon, Dawson, Chawda, IEEE SMC-B 35(5), 2005.

Scaled translation and rotation, as a homography gives them, are the errors: e1 and e2 the goal's
place in the robot's frame over the depth d* of the plane, e3 the heading error. A turn that never
rests, e2^2 sin t, moves what no smooth law that knows no time can: e2. With

    v = k_v e1,  w = -k_w e3 + k_s |e2| e2 sin(s t)

(e1^2 + e2^2)' = -2 k_v e1^2 / d*, so that e1 goes to zero, e2 w too, and then e2 and e3. This form
needs no estimate of d*, and turns to the goal's side first, which loses fewer features. As in the
original convergence is not exponential: the turn fades with e2.
"""

from dataclasses import dataclass
import math

from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.settings import setting, Settings
from visual_servo_epipolar.evaluation.benchmarks.laws.pose_measurement import RelativePose


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
