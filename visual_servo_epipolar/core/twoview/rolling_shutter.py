"""
Rolling shutter: how long the readout of an image takes, estimated as the camera turns.

Rows that are read one after another shear an image by the turn rate times the readout. The rate is
that between two images. An image of a camera that turns, compared with one of a camera at rest,
shows the shear: neither a turn explains it nor driving ahead, which moves features to and from
the direction of travel alone. Parallax of a camera off the axle grows with the turn, not with its
rate.
"""

from dataclasses import dataclass, field, replace
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, frozen, median, ROUNDING
from visual_servo_epipolar.core.geometry.least_squares import (
    cauchy,
    CONTRADICTING,
    deviation_of,
    REWEIGHTINGS,
    robust_fit,
)
from visual_servo_epipolar.core.geometry.rays import dot, rotation_level_camera
from visual_servo_epipolar.core.geometry.rotation import fit_rotation, rotated, rotation_vector
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.twoview.hypotheses import WORST
from visual_servo_epipolar.core.twoview.observation import Observation

FEWEST = 12  # features in both images: four unknowns, and some of them may be wrong
OF_ONE_IMAGE = 0.1  # in a mean that follows: of times between images, of the noise
SWING_WEIGHT = 0.2  # of one image in the variance of rates that alternate
AT_REST, TURNING = 0.06, 0.1  # turn rates of images that are compared [rad/s]
LONGEST_S = 1.5  # between them
JERKY, TYPICAL_S = 0.25, 0.02  # part of a jump by which a rate may be off; a usual readout [s]
OFF_AXLE = 0.03  # deviation of the shear that parallax causes in a turn of 1 rad [rad]
ASIDE = 0.1  # part of the parallax that is not along the direction of travel
LEAST_SINE = 0.05  # of the angle between a ray and the direction of travel, that is divided by
MODEL_S = 1e-3  # least deviation of a readout, of however many images
SLOWEST_S = 0.1  # deviation of a readout of which nothing is known
PRIOR = frozen(np.diag([SLOWEST_S**-2, OFF_AXLE**-2, 0.0]))
NOTHING = frozen(np.zeros(3))


class BaseAxes(NamedTuple):
    """Directions ahead and up of the base, in axes of the camera, shape (3,) each."""

    ahead: FloatArray
    up: FloatArray


def base_axes(tilt: float, roll: float, yaw: float) -> BaseAxes:
    """Return the axes of the base in those of a camera at these angles [rad]."""
    level = rotation_level_camera(tilt, roll)
    return BaseAxes(np.array([math.sin(yaw), 0.0, math.cos(yaw)]) @ level, -level[1])


@dataclass(frozen=True, slots=True)
class TurnRate:
    """
    Turn rate of the base from image to image, to the left [rad/s]; nan while unknown.

    ``mean`` is that between the last two images, ``before`` the one before, ``now`` that at the
    last image. ``growth`` is by how much it grew from image to image, as rows show it, and
    ``swing`` the variance of what of that alternates [rad^2/s^2].
    """

    mean: float = math.nan
    before: float = math.nan
    now: float = 0.0
    growth: float = math.nan
    swing: float = 0.0

    def followed_by(self, mean: float) -> 'TurnRate':
        """Return the rate after one more interval: it goes on to grow as it did."""
        grown = 0.0 if math.isnan(self.mean) else mean - self.mean
        return replace(self, mean=mean, before=self.mean, now=mean + 0.5 * grown)

    def seen_in_rows(self, growth: float, variance: float) -> 'TurnRate':
        """
        Return the rate with its ``growth`` since the image before, as rows show it [rad/s].

        A base that turns to and fro from image to image does not show in means. What alternates
        counts as far as it varies by more than its ``variance``; the rest may be parallax.
        """
        if math.isnan(self.growth):
            return replace(self, growth=growth)
        part, noise = 0.5 * (growth - self.growth), 0.5 * variance
        swing = self.swing + SWING_WEIGHT * (part**2 - noise - self.swing)
        share = max(swing, 0.0) / (max(swing, 0.0) + noise)
        return replace(self, now=self.now + 0.5 * share * part, growth=growth, swing=swing)


@dataclass(frozen=True, slots=True, eq=False)
class RollingShutter:
    """
    Estimate of the readout, by the images so far.

    ``information``, (3, 3), and ``weighted``, (3,), are those of the readout [s], of the shear per
    turn [1], and of the shear of the ``reference`` [rad], a view with its turn rate, at rest.
    Views are as they were read, row by row. ``rate`` is the turn rate, and ``up`` what it turns
    about, in axes of the camera; ``period`` the mean time between two images [s], of so many
    ``intervals``; ``first`` the first view of them, whose rate is still unknown.
    """

    information: FloatArray = field(default_factory=lambda: PRIOR)
    weighted: FloatArray = field(default_factory=lambda: NOTHING)
    reference: tuple[Observation, float] | None = None
    first: Observation | None = None
    last: Observation | None = None
    rate: TurnRate = TurnRate()
    up: FloatArray = field(default_factory=lambda: NOTHING)
    period: float = 0.0
    intervals: int = 0

    def readout(self, configured: float) -> float:
        """Return the readout [s]: the ``configured`` one, if images do not contradict it."""
        return self.estimate[0] if self.contradicts(configured) else configured

    def contradicts(self, configured: float) -> bool:
        """Return whether images contradict the ``configured`` readout [s]."""
        value, deviation = self.estimate
        return (value - configured) ** 2 > CONTRADICTING * deviation**2

    @property
    def estimate(self) -> tuple[float, float]:
        """Readout [s], negative where the last row comes first, and its deviation."""
        information = self.information
        if not information[2, 2] > 0.0:
            information = information + np.diag([0.0, 0.0, 1.0])
        covariance = np.linalg.inv(information)
        value = float(covariance[0] @ self.weighted)
        return value, math.hypot(math.sqrt(covariance[0, 0]), MODEL_S)

    def turn(self, configured: float) -> FloatArray:
        """Return the turn of the camera during the readout, in its axes, shape (3,) [rad]."""
        return self.readout(configured) * self.rate.now * self.up

    def updated(
        self, observation: Observation, axes: BaseAxes, configured: float
    ) -> 'RollingShutter':
        """Return the estimate after an image; ``configured`` is the readout as it was [s]."""
        if observation.rows is None or observation.ids is None:
            return self._anew(None)
        last = self.last
        if last is None or observation.stamp_ns <= last.stamp_ns:
            return replace(self._anew(observation), period=0.0, intervals=0)
        seconds = seconds_between(last.stamp_ns, observation.stamp_ns)
        after = self._timed(seconds)
        pair = RowPair.of(last, observation, axes.up)
        if pair is None:
            return after._anew(observation)
        mean = pair.turn / (after.period * max(1, round(seconds / after.period)))
        if not math.isnan(self.rate.mean):
            after = after._compared_last(last, mean, axes)
        rate, readout = self.rate.followed_by(mean), self.readout(configured)
        shear = pair.shear(axes) if readout != 0.0 else None
        if shear is not None:
            value, deviation = shear
            rate = rate.seen_in_rows(value / readout, (deviation / readout) ** 2)
        return replace(after, last=observation, rate=rate, up=axes.up)

    def _anew(self, view: Observation | None) -> 'RollingShutter':
        """Return the estimate where nothing is known of the motion before a ``view``."""
        return replace(self, first=view, last=view, rate=TurnRate())

    def _timed(self, gap: float) -> 'RollingShutter':
        """Return the estimate with the mean time between images after one more of ``gap`` [s]."""
        count = self.intervals + 1
        weight = max(1.0 / count, OF_ONE_IMAGE)
        return replace(self, period=self.period + weight * (gap - self.period), intervals=count)

    def _compared_last(self, last: Observation, mean: float, axes: BaseAxes) -> 'RollingShutter':
        """Return the estimate after the last view, which a turn at a ``mean`` rate followed."""
        rate, after = self.rate, self
        middle, jump = 0.5 * (rate.mean + mean), abs(mean - rate.mean)
        if self.first is not None:  # it accelerated as it did thereafter
            after = after._compared(self.first, 2.0 * rate.mean - middle, jump, axes)
        if not math.isnan(rate.before):
            jump = max(jump, abs(rate.mean - rate.before))
        return replace(after._compared(last, middle, jump, axes), first=None)

    def _compared(
        self, view: Observation, rate: float, jump: float, axes: BaseAxes
    ) -> 'RollingShutter':
        """
        Return the estimate after a ``view`` at which the base turned at ``rate`` [rad/s].

        Around it the rate changed by a ``jump`` [rad/s] from image to image.
        """
        if abs(rate) < AT_REST:
            return replace(self._without_reference(), reference=(view, rate))
        if abs(rate) < TURNING or self.reference is None:
            return self
        reference, at_rest = self.reference
        if seconds_between(reference.stamp_ns, view.stamp_ns) > LONGEST_S:
            return self
        pair = RowPair.of(reference, view, axes.up)
        shear = pair and pair.shear(axes)
        if pair is None or shear is None:
            return self
        value, deviation = shear
        unsure = JERKY * jump * max(abs(self.estimate[0]), TYPICAL_S)
        slope = np.array([rate - at_rest, pair.turn, 1.0])
        weight = 1.0 / (deviation**2 + unsure**2)
        of_reference = 0.0 if self.information[2, 2] > 0.0 else weight
        known = self.information + np.diag([0.0, 0.0, of_reference])
        return replace(
            self,
            information=known + weight * np.outer(slope, slope),
            weighted=self.weighted + weight * value * slope,
        )

    def _without_reference(self) -> 'RollingShutter':
        """Return the estimate for another reference: the shear of the last one is over."""
        information, weighted = self.information, self.weighted
        if not information[2, 2] > 0.0:
            return self
        share = information[:, 2] / information[2, 2]
        return replace(
            self,
            information=information - np.outer(share, information[2]),
            weighted=weighted - share * weighted[2],
        )


class RowPair(NamedTuple):
    """
    Two views of the same features: rays before and now, shape (N, 3), and ``rows`` now, (N,).

    The best rotation of the rays is ``rotation``, (3, 3), that of the camera a ``turn`` of the
    base to the left [rad]; ``parallax`` [rad] is what it leaves.
    """

    source: FloatArray
    rays: FloatArray
    rows: FloatArray
    rotation: FloatArray
    turn: float
    parallax: float

    @classmethod
    def of(cls, before: Observation, now: Observation, up: FloatArray) -> 'RowPair | None':
        """Return what both views show; None if that are too few features."""
        if before.ids is None or now.ids is None or now.rows is None:
            return None
        _, there, here = np.intersect1d(before.ids, now.ids, return_indices=True)
        if len(here) < FEWEST:
            return None
        source, rays = before.current[there], now.current[here]
        fit = fit_rotation(source, rays)
        turn = -float(rotation_vector(fit.rotation) @ up)
        return cls(source, rays, now.rows[here], fit.rotation, turn, fit.parallax)

    def shear(self, axes: BaseAxes) -> tuple[float, float] | None:
        """
        Return the shear from the first row to the last, and its deviation [rad].

        It is what a turn of the base and its way ahead do not explain; None where the features lie
        so close together that a turn and a shear look alike. A ray r of row y, from the middle, is
        moved by turn x r + s y (r x up) + parallax; across the plane of r and the direction of
        travel there is no parallax. By robust least squares.
        """
        rays = self.rays
        travel = rotated(axes.ahead, -0.5 * self.turn * axes.up)  # as the chord of an arc
        across = np.cross(travel, rays)
        across /= np.maximum(np.sqrt(dot(across, across)), LEAST_SINE)[:, None]
        shift = dot(across, rays - self.source @ self.rotation.T)
        # across . (turn x r) = turn . (r x across)
        moved = dot(across, np.cross(rays, axes.up) * self.rows[:, None])
        columns = np.column_stack([np.cross(rays, across), moved])
        fit = robust_fit(columns, shift, _weights, REWEIGHTINGS)
        if fit is None:
            return None
        deviation = _noise(fit.residual) * math.sqrt(fit.covariance()[3, 3])
        return float(fit.solution[3]), math.hypot(deviation, ASIDE * self.parallax)


def _noise(misses: FloatArray) -> float:
    return max(deviation_of(median(np.abs(misses))), ROUNDING)


def _weights(misses: FloatArray) -> FloatArray:
    return cauchy(misses * misses, WORST * _noise(misses) ** 2)
