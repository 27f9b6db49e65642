"""Pose filter: where the robot is near the goal, averaged over views by what it drove."""

from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.mapping.adjustment.window import HEADING
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.core.odometry.increments import Motion

# Unknowns: the place, right and ahead [m], and heading error [rad]; the share of a way that leads
# to the side, as a camera may look elsewhere than where the base drives.
PLACE = HEADING + 1
SLIP, UNKNOWNS = PLACE, PLACE + 1
FIRST_SLIP, SLIP_WALK = 0.05, 0.02  # its deviation at first, and its change after a metre
TURN_OF_WAY, ASIDE = 0.1, 0.003  # turn that a way may add [rad/m], and what it leads aside by
SURPRISE = 16.0  # square of a leap, in deviations, after which what was known counts no more
LEAST_DEVIATION = 1e-9  # [m], [rad]
LEAST = LEAST_DEVIATION**2 * np.eye(PLACE)
IDENTITY = np.eye(UNKNOWNS)


@dataclass(frozen=True, slots=True, eq=False)
class FilteredPose:
    """Where the camera is, less the shrinkage's shift, and its slip, (4,), of own noise."""

    mean: FloatArray
    covariance: FloatArray
    decayed_motion: Motion = Motion()

    @property
    def slip(self) -> float:
        """Share of a way that leads to the right of where the camera looks."""
        return float(self.mean[SLIP])

    def after(self, motion: Motion) -> 'FilteredPose':
        """Return the place after a ``motion``, as far as a base obeys, or its wheels grip."""
        share, before = motion.noise, self.decayed_motion
        heading = float(self.mean[HEADING]) + 0.5 * motion.turn
        ahead, aside = motion.way * math.cos(heading), motion.way * math.sin(heading)
        step = [self.slip * ahead - aside, ahead + self.slip * aside, motion.turn, 0.0]
        way = max(abs(motion.way), share.fading * before.way)
        turn = max(abs(motion.turn), share.fading * before.turn)
        across = way * abs(math.sin(heading))
        # A command may act by a view sooner or later.
        late = 0.0 if motion.measured else abs(abs(motion.way) - before.way)
        doubt = np.array(
            [
                share.way * across + way * (turn + ASIDE),
                math.hypot(share.way * way, late),
                share.turn * turn + TURN_OF_WAY * way,
                0.0,
            ]
        )
        transition = IDENTITY.copy()
        transition[:2, SLIP] = ahead, aside
        covariance = transition @ self.covariance @ transition.T
        diagonal = covariance.ravel()[:: UNKNOWNS + 1]
        diagonal += doubt * doubt
        diagonal[SLIP] += SLIP_WALK * SLIP_WALK * way
        if share.noise:
            diagonal += share.noise**2 * np.array([across, way, way + turn, 0.0])
        return FilteredPose(self.mean + step, covariance, Motion(way, turn))


def first_pose(mean: FloatArray, own: FloatArray, decayed_motion: Motion) -> FilteredPose:
    """Return the place of one view alone, ``mean``, (3,), of covariance ``own``, (3, 3)."""
    covariance = np.diag([0.0] * PLACE + [FIRST_SLIP**2])
    covariance[:PLACE, :PLACE] = own
    return FilteredPose(np.append(mean, 0.0), covariance, decayed_motion)


def filter_pose(
    said: MapLocalization, place: FilteredPose | None, motion: Motion
) -> tuple[MapLocalization, FilteredPose | None]:
    """Return a recollection averaged with those before it, and the place for the next."""
    if said.reason:
        return said, None
    mean, own = said.pose[:PLACE] - said.shift[:PLACE], said.own[:PLACE, :PLACE] + LEAST
    if place is None:
        return said, first_pose(mean, own, Motion(abs(motion.way), abs(motion.turn)))
    before = place.after(motion)
    change = _change(said, before)
    both = np.empty((PLACE, UNKNOWNS + 1))
    both[:, :UNKNOWNS], both[:, UNKNOWNS] = before.covariance[:PLACE], change
    shares = np.linalg.solve(before.covariance[:PLACE, :PLACE] + own, both)
    gain = shares[:, :UNKNOWNS].T
    if change @ shares[:, UNKNOWNS] > SURPRISE:
        return said, first_pose(mean, own, before.decayed_motion)
    known = _symmetric(before.covariance - gain @ before.covariance[:PLACE])
    now = FilteredPose(before.mean + gain @ change, known, before.decayed_motion)
    pose, covariance, own = said.pose.copy(), said.covariance.copy(), said.own.copy()
    covariance[:PLACE, :PLACE] += known[:PLACE, :PLACE] - own[:PLACE, :PLACE]
    own[:PLACE, :PLACE] = known[:PLACE, :PLACE]
    pose[:PLACE] = now.mean[:PLACE] + said.shift[:PLACE]
    return replace(said, pose=pose, covariance=covariance, own=own), now


def with_heading_noise(said: MapLocalization, noise: float) -> MapLocalization:
    """Return what a view says whose heading has a ``noise`` of its own [rad]."""
    covariance, own = said.covariance.copy(), said.own.copy()
    covariance[HEADING, HEADING] += noise * noise
    own[HEADING, HEADING] += noise * noise
    return replace(said, covariance=covariance, own=own)


def agrees(said: MapLocalization, place: FilteredPose) -> bool:
    """Return whether a recollection is of a robot at ``place``, within the noise of a view."""
    change = _change(said, place)
    covariance = said.own[:PLACE, :PLACE] + place.covariance[:PLACE, :PLACE]
    return float(change @ np.linalg.solve(covariance, change)) <= SURPRISE


def _change(said: MapLocalization, place: FilteredPose) -> FloatArray:
    """Return where a recollection is, (3,), less a ``place``."""
    change = said.pose[:PLACE] - said.shift[:PLACE] - place.mean[:PLACE]
    change[HEADING] = math.remainder(change[HEADING], 2.0 * math.pi)
    return np.asarray(change)


def _symmetric(matrix: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (matrix + matrix.T))
