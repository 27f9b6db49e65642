"""
Base model: its delay, the curvature that it adds, and physical bounds of both.

For each possible delay the commands give the turn between two views; the delay whose turns fit the
observed ones best is that of the base, worn wheels or not. A base that begins late may have been
held; one that ends late as well has a delay.

Physical bounds hold whatever the motion seems to teach; two more are where their layers are: the
focal ratio (``geometry.lens.MOST_RATIO``), and the mount of the camera, which is the configured
one, and its deviations (``extrinsics.PLAUSIBLE``).
"""

from dataclasses import dataclass, field, replace
from functools import lru_cache
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimate.settings import DriveSettings, SettingsT, with_identified
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.twoview.measurement import Measurement

MOST_CURVATURE = 0.3  # of wheels that shall roll straight on: unequal by a tenth [rad/m]
MOST_DELAY_S = 1.5  # from an image to the motion that it causes [s]
MOST_CONTRADICTIONS = 3  # of commands or odometry, less the times that they agreed since
MOST_TURN_RATIO = 1.6  # of a turn over that commanded
# Way by the wheels over that commanded: no base drives farther, and many drive less.
FASTER, SLOWER = 1.25, 0.5
# What any base follows [m/s, rad/s], or a larger part of the largest velocity.
FOLLOWED, FOLLOWED_PART = 0.065, 0.2
LATENCY_S = 0.2  # from a command to the image that shows its effect
CHANGE_DECAY = 0.5  # of a change of the angular velocity, in one frame
LEAST_HEADING_VARIANCE = 5e-4**2  # [rad^2]
NOISE_OF_PARALLAX = 2.0  # that it is at most without any, in deviations of a coordinate
FIRST_VARIANCE = 0.05**2  # of the curvature: 3 deg/m [rad^2/m^2]
BORNE = 0.25  # up to which laws bear a delay as it is [s]
STEP_S = 0.05  # between two delays that may be [s]
DELAYS: FloatArray = np.arange(round(MOST_DELAY_S / STEP_S) + 1, dtype=np.float64) * STEP_S
INTERVAL = 0.095  # between two headings that tell a turn, at least [s]
FADING = 0.15  # sum of squared turns in which what was seen falls to 1/e: it may be a push [rad^2]
MOST_DEVIATION = 0.01  # of a heading that tells a turn [rad]
LEAST_TURN = 2e-3  # that is seen in an interval [rad]
PUSHED = 1.5  # times the largest turn that may be commanded: it was not the base
LEAST_POWER = 0.01  # sum of squared turns that tells a delay [rad^2]
LEAST_RESPONSE_POWER = 2e-3  # the same, where none is changed for it [rad^2]
SOON_S = 0.5  # in which a base follows whose delay is unknown
LEAST_CHANGE = 1e-3  # of squares that a delay adds, and takes away, in beginnings and ends [rad^2]
GAINS = 0.6, 1.6  # turns seen over turns commanded, of a base that obeys
UNEXPLAINED = 0.15  # most share of squared turns that the delay leaves
CLEARLY = 3.0  # times as much is left without it


def largest_dead_band(limit: float) -> float:
    """Return what any base follows whose largest velocity is ``limit`` [m/s, rad/s]."""
    return min(max(FOLLOWED, FOLLOWED_PART * limit), limit)


@dataclass(frozen=True, slots=True)
class Curvature:
    """
    Curvature that the base adds to every command: ``value`` [rad/m] and ``variance`` [rad^2/m^2].

    ``change`` is the largest recent change of the angular velocity, decayed, and ``last_angular``
    the angular velocity commanded last [rad/s].
    """

    value: float = 0.0
    variance: float = FIRST_VARIANCE
    change: float = 0.0
    last_angular: float = 0.0

    def updated(
        self,
        previous: Measurement | None,
        measurement: Measurement,
        twist: Twist,
        dt: float,
        *,
        drift: float,
    ) -> 'Curvature':
        """
        Return the curvature after ``twist`` for ``dt`` [s]: one step of a scalar Kalman filter.

        The state c is a random walk of ``drift`` [rad/m] in a metre. With s = u_1 dt the turn of
        the heading between the measurements is u_2 dt + c s + noise. A command reaches the wheels
        late by an unknown part of LATENCY_S, so that a change of u_2 counts as heading noise.
        """
        change = max(abs(twist.angular - self.last_angular), CHANGE_DECAY * self.change)
        driven = dt != 0.0 and measurement.bearings is not None
        if previous is None or previous.bearings is None or not driven:
            return Curvature(self.value, self.variance, change, twist.angular)
        travel = twist.linear * dt
        turn = math.remainder(measurement.heading_error - previous.heading_error, 2.0 * math.pi)
        innovation = turn - twist.angular * dt - self.value * travel
        variance = self.variance + drift**2 * abs(travel)
        late = (LATENCY_S * change) ** 2
        noise = late + _heading_noise(previous) + _heading_noise(measurement)
        gain = variance * travel / (variance * travel * travel + noise)
        value = min(max(self.value + gain * innovation, -MOST_CURVATURE), MOST_CURVATURE)
        return Curvature(value, variance * (1.0 - gain * travel), change, twist.angular)


def heading_deviation(measurement: Measurement) -> float:
    """Return the deviation of the heading error by a memory, or by two views [rad]; or inf."""
    if math.isfinite(measurement.heading_deviation):
        return measurement.heading_deviation
    if measurement.bearings is not None:
        return math.sqrt(max(heading_variance(measurement), LEAST_HEADING_VARIANCE))
    if math.isnan(measurement.parallax):
        return math.inf
    # A rotation alone takes for a turn what is parallax, but for the noise in it.
    parallax = measurement.parallax - NOISE_OF_PARALLAX * measurement.noise
    return max(parallax, math.sqrt(LEAST_HEADING_VARIANCE))


def heading_variance(measurement: Measurement) -> float:
    """Return the variance of alpha = psi - phi - pi/2 by two views [rad^2]; nan while unknown."""
    (psi, psi_phi), (_, phi) = measurement.covariance.tolist()
    return float(psi + phi - 2.0 * psi_phi)


def _heading_noise(measurement: Measurement) -> float:
    """Return the variance of a heading [rad^2], never below the least, which stands for nan."""
    variance = heading_variance(measurement)
    return LEAST_HEADING_VARIANCE if math.isnan(variance) else variance + LEAST_HEADING_VARIANCE


@dataclass(frozen=True, eq=False)
class Delay:
    """
    Delay ``value`` [s], 0 until it is known.

    Rows of ``sums``, (4, 31), by DELAYS, are of turns seen times those commanded, of the squares
    of the latter, and of the squares of what a delay makes the turns of an interval smaller and
    larger by, as where they begin and end; ``energy`` of the squares of turns seen [rad^2]. The
    interval since ``since_ns`` began at a ``heading`` error [rad], which was given ``by_memory``
    or by two views; nan before the first.
    """

    value: float = 0.0
    sums: FloatArray = field(default_factory=lambda: np.zeros((4, len(DELAYS))))
    energy: float = 0.0
    since_ns: int = 0
    heading: float = math.nan
    by_memory: bool = False

    def updated(
        self, measurement: Measurement, sent: CommandsSent, settings: DriveSettings
    ) -> 'Delay':
        """Return the delay after one more image."""
        if not settings.options.anticipation or heading_deviation(measurement) > MOST_DEVIATION:
            return self
        now_ns, heading = measurement.stamp_ns, measurement.heading_error
        by_memory = measurement.offset is not None
        goes_on = by_memory is self.by_memory and not math.isnan(self.heading)
        gap = seconds_between(self.since_ns, now_ns)
        if goes_on and 0.0 < gap < INTERVAL:
            return self
        began = replace(self, since_ns=now_ns, heading=heading, by_memory=by_memory)
        if not goes_on:
            return began
        turn = math.remainder(heading - self.heading, 2.0 * math.pi)
        if (
            not 0.0 < gap <= settings.stale_timeout
            or abs(turn) > PUSHED * settings.max_angular * gap
        ):
            return began
        turns = sent.turns(self.since_ns, now_ns, DELAYS)
        commanded = float(np.abs(turns).max())
        # Of a turn that no base need follow, none tells nothing.
        if abs(turn) < LEAST_TURN and commanded < gap * largest_dead_band(settings.max_angular):
            return began
        largest = max(abs(turn), commanded)
        keep = math.exp(-largest * largest / FADING)
        change = np.abs(turns) - abs(turns[_up_to(settings.configured_latency)[-1]])
        shorter, longer = np.minimum(change, 0.0), np.maximum(change, 0.0)
        more = np.stack([turn * turns, turns * turns, shorter * shorter, longer * longer])
        energy = keep * self.energy + turn * turn
        after = replace(began, sums=keep * self.sums + more, energy=energy)
        return replace(after, value=after._value(settings))

    def _value(self, settings: DriveSettings) -> float:
        """Return the delay that turns tell, the one before where they tell none for certain."""
        left = self._left(LEAST_POWER)
        usual, stated = _usual(settings.configured_latency), _up_to(settings.configured_latency)
        soon, best = int(left[usual].argmin()), int(left.argmin())
        if best not in usual:
            both_ends = self.sums[2:, best].min()
            clear = min(both_ends, left[stated].min()) >= max(CLEARLY * left[best], LEAST_CHANGE)
            return float(DELAYS[best]) if clear and self._fits(left, best) else self.value
        known = int(np.abs(DELAYS - self.value).argmin())
        wrong = self._fits(left, soon) and left[known] > CLEARLY * left[soon]
        return 0.0 if wrong else self.value

    def _left(self, least_power: float) -> FloatArray:
        """Return the squares of turns that each delay leaves unexplained, shape (31,) [rad^2]."""
        seen, power = self.sums[:2]
        left = self.energy - seen**2 / np.maximum(power, 1e-12)
        return np.where((seen > 0.0) & (power >= least_power), left, self.energy)

    def _fits(self, left: FloatArray, place: int) -> bool:
        """Return whether the delay in ``place`` explains the turns, with wheels that obey."""
        gain = self.sums[0, place] / max(self.sums[1, place], 1e-12)
        return bool(left[place] <= UNEXPLAINED * self.energy and GAINS[0] < gain < GAINS[1])

    @property
    def response(self) -> float:
        """How late it turns [s], finer than DELAYS; nan until turns tell."""
        left = self._left(LEAST_RESPONSE_POWER)
        best = int(left.argmin())
        if not 0.0 < left[best] <= UNEXPLAINED * self.energy:
            return math.nan
        if best in (0, len(left) - 1):
            return float(DELAYS[best])
        before, least, after = (float(each) for each in left[best - 1 : best + 2])
        return float(DELAYS[best]) + 0.5 * STEP_S * (before - after) / (before - 2 * least + after)

    def beside(self, settings: SettingsT) -> SettingsT:
        """Return ``settings`` with the delay that turns show, where it is longer."""
        # The one that fits best is a better guess than none at all, also before it is certain.
        late = self.value or (self.response if self.response > BORNE else 0.0)
        if not settings.options.anticipation or late <= settings.latency:
            return settings
        return with_identified(settings, latency=late)


def _usual(configured_s: float) -> range:
    """Return the places of the delays that need not be learnt, where one is configured [s]."""
    return _up_to(max(configured_s, BORNE))


@lru_cache(maxsize=16)
def _up_to(delay: float) -> range:
    return range(int(np.count_nonzero(delay >= DELAYS)))
