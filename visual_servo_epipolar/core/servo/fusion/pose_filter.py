"""Pose filter: where the robot is near the goal, averaged over views by what it drove."""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.lapack import solved
from visual_servo_epipolar.core.mapping.adjustment.window import HEADING
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.core.odometry.increments import Motion
from visual_servo_epipolar.core.values import changed

PLACE = HEADING + 1  # unknowns of a place: right and ahead [m], heading error [rad]
TURN_OF_WAY, SLIP = 0.1, 0.05  # turn that a way may add [rad/m], and its share to the side
SURPRISE = 16.0  # square of a leap, in deviations, after which what was known counts no more
LEAST_DEVIATION = 1e-9  # [m], [rad]
LEAST = LEAST_DEVIATION**2 * np.eye(PLACE)


@dataclass(frozen=True, slots=True, eq=False)
class FilteredPose:
    """Where the camera is, (3,), less the shrinkage's shift; ``covariance`` of own noise."""

    mean: FloatArray
    covariance: FloatArray
    decayed_motion: Motion = Motion()

    def after(self, motion: Motion) -> 'FilteredPose':
        """Return the place after a ``motion``, as far as a base obeys, or its wheels grip."""
        share = motion.noise
        heading = float(self.mean[HEADING]) + 0.5 * motion.turn
        step = [-motion.way * math.sin(heading), motion.way * math.cos(heading), motion.turn]
        way = max(abs(motion.way), share.fading * self.decayed_motion.way)
        turn = max(abs(motion.turn), share.fading * self.decayed_motion.turn)
        doubt = np.array(
            [
                way * (share.way * abs(math.sin(heading)) + turn + SLIP),
                share.way * way,
                share.turn * turn + TURN_OF_WAY * way,
            ]
        )
        covariance = self.covariance.copy()
        diagonal = covariance.ravel()[:: PLACE + 1]
        diagonal += doubt * doubt
        if share.noise:
            walk = np.array([way * abs(math.sin(heading)), way, way + turn])
            diagonal += share.noise**2 * walk
        return FilteredPose(self.mean + step, covariance, Motion(way, turn))


def filter_pose(
    said: MapLocalization, place: FilteredPose | None, motion: Motion
) -> tuple[MapLocalization, FilteredPose | None]:
    """Return a recollection averaged with those before it, and the place for the next."""
    if said.reason:
        return said, None
    mean, own = said.pose[:PLACE] - said.shift[:PLACE], said.own[:PLACE, :PLACE] + LEAST
    if place is None:
        return said, FilteredPose(mean, own, Motion(abs(motion.way), abs(motion.turn)))
    before = place.after(motion)
    change = _change(said, before)
    both = np.empty((PLACE, PLACE + 1))
    both[:, :PLACE], both[:, PLACE] = before.covariance, change
    shares = solved(before.covariance + own, both)
    gain = shares[:, :PLACE].T
    if change @ shares[:, PLACE] > SURPRISE:
        return said, FilteredPose(mean, own, before.decayed_motion)
    now = FilteredPose(
        before.mean + gain @ change, _symmetric(own @ gain.T), before.decayed_motion
    )
    pose, covariance, own = said.pose.copy(), said.covariance.copy(), said.own.copy()
    covariance[:PLACE, :PLACE] += now.covariance - own[:PLACE, :PLACE]
    own[:PLACE, :PLACE] = now.covariance
    pose[:PLACE] = now.mean + said.shift[:PLACE]
    return changed(said, pose=pose, covariance=covariance, own=own), now


def agrees(said: MapLocalization, place: FilteredPose) -> bool:
    """Return whether a recollection is of a robot at ``place``, within the noise of a view."""
    change = _change(said, place)
    covariance = said.own[:PLACE, :PLACE] + place.covariance
    return float(change @ solved(covariance, change)) <= SURPRISE


def _change(said: MapLocalization, place: FilteredPose) -> FloatArray:
    """Return where a recollection is, (3,), less a ``place``."""
    change = said.pose[:PLACE] - said.shift[:PLACE] - place.mean
    change[HEADING] = math.remainder(change[HEADING], 2.0 * math.pi)
    return np.asarray(change)


def _symmetric(matrix: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (matrix + matrix.T))
