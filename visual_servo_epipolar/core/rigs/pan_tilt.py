"""
Pan-tilt head: rays of a camera that turns, in axes that are fixed to the base.

Section IX of the paper: from the features of the pan-tilt camera follow those of a virtual camera
fixed to the base, by which the law drives, while the head keeps them in view. The pan axis is
vertical and the camera's centre is on it; tilt turns the camera about its own x axis.
"""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, median, packed
from visual_servo_epipolar.core.geometry.epipolar import rotation_desired_current
from visual_servo_epipolar.core.geometry.rays import rotation_level_camera
from visual_servo_epipolar.core.rigs.rig import Edges, Gaze, HeadCommand, HeadLimits, Joints, Lean

LEAST_SEEN = 6  # features whose shift tells where the others are
SEARCH_SPEED = 0.6  # of that of the head, by which images are not blurred
GAIN = 4.0  # of the rate towards an angle [1/s]
WAIT_S = 0.4  # before it searches: features come back by themselves
FEW_S = 2.0  # for which too few of them are enough: more may be in view at the other end


@dataclass(frozen=True, slots=True)
class PanTiltHead:
    """Head within its ``limits`` that turns its camera about the vertical, then tilts it."""

    limits: HeadLimits

    @property
    def turn_rate(self) -> float:
        """Rate at which it follows turns of the base [rad/s]."""
        return self.limits.pan_speed

    @property
    def search_time(self) -> float:
        """Time of one sweep from an end to the other and back [s]."""
        return 2.0 * self._range / (SEARCH_SPEED * self.limits.pan_speed)

    @property
    def photograph(self) -> Joints:
        """Angles at which the photograph was taken."""
        return self.limits.photograph

    @property
    def _range(self) -> float:
        return self.limits.pan_max - self.limits.pan_min

    def rays(self, rays: FloatArray, joints: Joints, lean: Lean | None = None) -> FloatArray:
        """Return unit rays, (N, 3), of the virtual camera, which sits as this one does at zero."""
        if not any(joints):
            return rays
        lean = lean or Lean(self.limits.tilt, self.limits.roll)
        at_zero = rotation_level_camera(lean.tilt, lean.roll)
        tilted = rotation_level_camera(lean.tilt + joints.tilt, lean.roll)
        turned = at_zero.T @ rotation_desired_current(joints.pan) @ tilted
        return np.asarray(rays @ turned.T)

    def edges(self, edges: Edges, joints: Joints) -> Edges:
        """Return the limits of the view, moved by the pan angle."""
        return edges[0] - joints.pan, edges[1] - joints.pan

    def reach(self, edges: Edges) -> Edges:
        """Return the limits of the view at either end of the pan joint."""
        return edges[0] - self.limits.pan_max, edges[1] - self.limits.pan_min

    def head_command(self, gaze: Gaze) -> HeadCommand:
        """
        Return the pan angle that keeps features where the photograph has them, ahead of a turn.

        They have moved by the median angle between both views: less a parallax it is minus the
        heading error, and zero at the goal. What the base turns until the next image is in it.
        Where too little is seen the head holds its eye on the world, then sweeps its range.
        """
        ahead = self.limits.latency + gaze.period
        if len(gaze.current) >= LEAST_SEEN and gaze.lost <= FEW_S:
            pan = self.limits.photograph.pan - _shift(gaze.current, gaze.desired)
            target = pan - gaze.twist.angular * ahead
            rate = GAIN * (pan - gaze.joints.pan) - gaze.twist.angular
        elif gaze.lost <= WAIT_S:
            target = gaze.joints.pan - gaze.twist.angular * ahead
            rate = -gaze.twist.angular
        else:
            target = self._swept(gaze.lost - WAIT_S + ahead)
            rate = GAIN * (target - gaze.joints.pan)
        target = min(max(target, self.limits.pan_min), self.limits.pan_max)
        tilt, fastest = self.limits.photograph.tilt, self.limits.pan_speed
        tilt_rate = min(max(GAIN * (tilt - gaze.joints.tilt), -fastest), fastest)
        return HeadCommand(target, tilt, self._within(rate, gaze.joints.pan), tilt_rate)

    def _swept(self, since: float) -> float:
        """
        Return the angle of a sweep ``since`` [s] it began: from the middle to either end.

        Each sweep takes twice the time of the one before: a head may be slower than configured.
        """
        middle = 0.5 * (self.limits.pan_min + self.limits.pan_max)
        sweeps = 1.0 + since / self.search_time
        share = sweeps / 2.0 ** math.floor(math.log2(sweeps)) - 1.0
        wave = 4.0 * abs(math.fmod(share + 0.75, 1.0) - 0.5) - 1.0
        return middle + 0.5 * self._range * wave

    def _within(self, rate: float, pan: float) -> float:
        """Return a ``rate`` within the head's speed that ends at its limits."""
        limits = self.limits
        rate = min(max(rate, -limits.pan_speed), limits.pan_speed)
        return min(max(rate, GAIN * (limits.pan_min - pan)), GAIN * (limits.pan_max - pan))


def _shift(current: FloatArray, desired: FloatArray) -> float:
    """Return the median angle about the vertical from ``desired`` to ``current`` [rad]."""
    now = np.arctan2(packed(current[:, 0]), packed(current[:, 2]))
    then = np.arctan2(packed(desired[:, 0]), packed(desired[:, 2]))
    moved = now - then
    mean = math.atan2(float(np.sin(moved).sum()), float(np.cos(moved).sum()))
    return mean + median(np.remainder(moved - mean + math.pi, 2.0 * math.pi) - math.pi)
