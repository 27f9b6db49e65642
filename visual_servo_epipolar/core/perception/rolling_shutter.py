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

from visual_servo_epipolar.core.arrays import FloatArray, frozen, IntArray, median
from visual_servo_epipolar.core.geometry.rays import dot
from visual_servo_epipolar.core.geometry.rotation import fit_rotation, rotated, rotation_vector
from visual_servo_epipolar.core.lapack import inverse, solved
from visual_servo_epipolar.core.perception.observation import Observation
from visual_servo_epipolar.core.stamps import seconds_between

FEWEST = 12  # features in both images: four unknowns, and some of them may be wrong
PERIOD_WEIGHT = 0.1  # of a time between two images in its mean: stamps at receipt jitter
AT_REST, TURNING = 0.06, 0.1  # turn rates of images that are compared [rad/s]
LONGEST_S = 1.5  # between them
OFF_AXLE = 0.03  # deviation of the shear that parallax causes in a turn of 1 rad [rad]
ASIDE = 0.1  # part of the parallax that is not along the direction of travel
ROUNDS, OUTLYING = 4, 2.5  # of a robust fit; deviations at which a feature counts half
NORMAL = 1.4826  # deviation over median of absolute values
LEAST_RAD = 1e-9  # deviation of a ray that is divided by
LEAST_SINE = 0.05  # of the angle between a ray and the direction of travel, likewise
MODEL_S = 1e-3  # least deviation of a readout, of however many images
CERTAIN = 4.0  # deviations of a readout from the configured one
SLOWEST_S = 0.1  # deviation of a readout of which nothing is known
PRIOR = frozen(np.diag([SLOWEST_S**-2, OFF_AXLE**-2, 0.0]))
NOTHING = frozen(np.zeros(3))


class RowView(NamedTuple):
    """Uncorrected rays, shape (N, 3), of features by ``ids``, and their ``rows``, (N,)."""

    stamp_ns: int
    ids: IntArray
    rays: FloatArray
    rows: FloatArray


class TurningView(NamedTuple):
    """A view, and the angular velocity of the camera then, in its axes, shape (3,) [rad/s]."""

    view: RowView
    rate: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class RollingShutter:
    """
    Estimate of the readout, by the images so far.

    ``information``, (3, 3), and ``weighted``, (3,), are those of the readout [s], of the shear per
    turn [1], and of the shear of the ``reference`` [rad], which is at rest. ``rate`` is the
    angular velocity between the last two images, (3,) [rad/s], None if unknown; ``period`` the
    mean time between two images [s], of so many ``intervals``; ``first`` the first view of them,
    whose rate is still unknown.
    """

    information: FloatArray = field(default_factory=lambda: PRIOR)
    weighted: FloatArray = field(default_factory=lambda: NOTHING)
    reference: TurningView | None = None
    first: RowView | None = None
    last: RowView | None = None
    rate: FloatArray | None = None
    period: float = math.nan
    intervals: int = 0

    def readout(self, configured: float) -> float:
        """Return the readout [s]: the ``configured`` one, if images do not contradict it."""
        return self.estimate[0] if self.contradicts(configured) else configured

    def contradicts(self, configured: float) -> bool:
        """Return whether images contradict the ``configured`` readout [s]."""
        value, deviation = self.estimate
        return abs(value - configured) > CERTAIN * deviation

    @property
    def estimate(self) -> tuple[float, float]:
        """Readout [s], negative where the last row comes first, and its deviation."""
        information = self.information
        if not information[2, 2] > 0.0:
            information = information + np.diag([0.0, 0.0, 1.0])
        covariance = inverse(information)
        value = float(covariance[0] @ self.weighted)
        return value, math.hypot(math.sqrt(covariance[0, 0]), MODEL_S)

    def turn(self, configured: float) -> FloatArray:
        """Return the turn of the camera during the readout, in its axes, shape (3,) [rad]."""
        return NOTHING if self.rate is None else self.readout(configured) * self.rate

    def updated(self, observation: Observation, forward: FloatArray) -> 'RollingShutter':
        """Return the estimate after an image; the robot drives along ``forward``, (3,)."""
        if observation.rows is None or observation.ids is None:
            return replace(self, first=None, last=None, rate=None)
        now = RowView(observation.stamp_ns, observation.ids, observation.current, observation.rows)
        last = self.last
        if last is None or now.stamp_ns <= last.stamp_ns:
            return replace(self, first=now, last=now, rate=None, period=math.nan, intervals=0)
        after = self._timed(seconds_between(last.stamp_ns, now.stamp_ns))
        before, here = _shared(last, now)
        if len(here) < FEWEST:
            return replace(after, first=now, last=now, rate=None)
        gap = after.period * max(
            1, round(seconds_between(last.stamp_ns, now.stamp_ns) / after.period)
        )
        rate = -rotation_vector(fit_rotation(last.rays[before], now.rays[here]).rotation) / gap
        if self.rate is not None:
            middle = 0.5 * (self.rate + rate)
            if self.first is not None:  # it accelerated as it did thereafter
                after = after._compared(self.first, 2.0 * self.rate - middle, forward)
            after = replace(after._compared(last, middle, forward), first=None)
        return replace(after, last=now, rate=rate)

    def _timed(self, gap: float) -> 'RollingShutter':
        """Return the estimate with the mean time between images after one more of ``gap`` [s]."""
        count = self.intervals + 1
        if count == 1:
            return replace(self, period=gap, intervals=1)
        weight = max(1.0 / count, PERIOD_WEIGHT)
        return replace(self, period=self.period + weight * (gap - self.period), intervals=count)

    def _compared(self, view: RowView, rate: FloatArray, forward: FloatArray) -> 'RollingShutter':
        """Return the estimate after a ``view`` at which the camera turned at ``rate``."""
        speed, reference = float(np.linalg.norm(rate)), self.reference
        if speed < AT_REST:
            return replace(self._without_reference(), reference=TurningView(view, rate))
        if speed < TURNING or reference is None:
            return self
        if seconds_between(reference.view.stamp_ns, view.stamp_ns) > LONGEST_S:
            return self
        shear = sheared(reference, TurningView(view, rate), forward)
        if shear is None:
            return self
        slope, weight = np.array([shear.faster, shear.turn, 1.0]), shear.deviation**-2
        of_reference = 0.0 if self.information[2, 2] > 0.0 else weight
        known = self.information + np.diag([0.0, 0.0, of_reference])
        return replace(
            self,
            information=known + weight * np.outer(slope, slope),
            weighted=self.weighted + weight * shear.value * slope,
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


class Shear(NamedTuple):
    """
    Shear of one view against another, from the first row to the last, and its deviation [rad].

    In between the camera turned by ``turn`` [rad], and its rate grew by ``faster`` [rad/s].
    """

    value: float
    deviation: float
    turn: float
    faster: float


def sheared(before: TurningView, now: TurningView, forward: FloatArray) -> Shear | None:
    """
    Return the shear that rotation and driving along ``forward`` do not explain, by least squares.

    A ray r of row y, from the middle, is moved by turn x r + s y (r x axis) + parallax; across
    the plane of r and the direction of travel there is no parallax. None of too few features.
    """
    there, here = _shared(before.view, now.view)
    if len(here) < FEWEST:
        return None
    source, rays, rows = before.view.rays[there], now.view.rays[here], now.view.rows[here]
    fit = fit_rotation(source, rays)
    turn, faster = rotation_vector(fit.rotation), now.rate - before.rate
    speed = float(np.linalg.norm(faster))
    travel = rotated(forward, 0.5 * turn)  # half-way turned, as the chord of an arc
    across = np.cross(travel, rays)
    across /= np.maximum(np.sqrt(dot(across, across)), LEAST_SINE)[:, None]
    shift = dot(across, rays - source @ fit.rotation.T)
    sheared_by = np.cross(rays, faster / speed) * rows[:, None]
    # across . (turn x r) = turn . (r x across)
    columns = np.column_stack([np.cross(rays, across), dot(across, sheared_by)])
    weights = np.ones(len(rays))
    for _ in range(ROUNDS):
        normal = columns.T @ (columns * weights[:, None])
        solution = solved(normal, columns.T @ (weights * shift))
        misses = shift - columns @ solution
        noise = max(NORMAL * median(np.abs(misses)), LEAST_RAD)
        weights = 1.0 / (1.0 + (misses / (OUTLYING * noise)) ** 2)
    deviation = noise * math.sqrt(inverse(normal)[3, 3])
    return Shear(
        float(solution[3]),
        math.hypot(deviation, ASIDE * fit.parallax),
        -float(turn @ faster) / speed,
        speed,
    )


def _shared(before: RowView, now: RowView) -> tuple[IntArray, IntArray]:
    """Return where in either view the features are that both show."""
    _, there, here = np.intersect1d(before.ids, now.ids, return_indices=True)
    return there, here
