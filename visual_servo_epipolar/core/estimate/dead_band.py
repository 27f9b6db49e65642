"""Dead band: the velocities that a base does not follow, estimated where it stands instead."""

from dataclasses import dataclass, replace
import math

from visual_servo_epipolar.core.estimate.base_model import (
    heading_deviation,
    largest_dead_band,
    MOST_CURVATURE,
)
from visual_servo_epipolar.core.estimate.settings import DriveSettings, SettingsT, with_identified
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.mapping.localization import MapMeasurement
from visual_servo_epipolar.core.perception.measurement import Measurement

LATE_S = 0.5  # by which a base may follow late
PATIENCE_S = 1.5  # in which it follows if it does at all
LEAST_ASKED = 0.003  # motion, below which laws and delays make anything of it [m], [rad]
STANDING = 0.5  # of what was commanded: a base that moved less stands, at least now and then
OF_PULSES = 0.15  # the same of pulses, most of which a base may spend on speeding up
SMOOTHING = 0.2  # weight of the newest position of a standing robot
MANY = 4.0  # pulses, of which one may not have acted yet
DEVIATIONS = 8.0  # of a position, that the motion commanded must be
# Over the velocity that was not followed, and over one of about what was learnt already: it may be
# twenty times as fast that is followed.
MARGIN, MARGIN_AGAIN, LEARNT = 1.3, 1.9, 0.8
UNLIKE = 0.25  # of a curvature, by which two differ: measured to 1 / DEVIATIONS each
MOST_HOP = 0.005, math.radians(0.5)  # half a pulse: no end may be wider for it [m], [rad]
# Up to which speed [m/s], and way of a turn [m/rad], a base at rest may have a dead band;
# beyond, it is deaf.
CREEPING, MOST_WAY = 0.002, 2.0
REFINING = 0.005  # of a distance, that it changes by while a memory learns its scale


@dataclass(frozen=True, slots=True)
class Threshold:
    """
    Least velocity that one axis follows: ``value``, 0 until it was seen to stand below one.

    Commands to one ``side`` (1 or -1, 0 without any) have ``lasted`` [s], and there was none for
    the last ``idle`` [s]; since the position was ``origin`` they ``asked`` for a motion, ``power``
    the sum of their squares over time. Before that it ``stood`` below such a velocity: once may
    have been measured wrong, it takes two times. Metres or radians.

    Wheels of a curvature ``bend`` [rad/m] would have undone the turn on the ``way`` [m]; inf where
    there was none. No wheels undo turns of two different curvatures. Of that way the base was seen
    to have ``gone`` a part.
    """

    value: float = 0.0
    side: float = 0.0
    lasted: float = 0.0
    origin: float = math.nan
    asked: float = 0.0
    power: float = 0.0
    stood: float = 0.0
    idle: float = 0.0
    way: float = 0.0
    gone: float = 0.0
    bend: float = math.inf

    def updated(
        self,
        position: float,
        deviation: float,
        velocity: float,
        dt: float,
        *,
        most: float,
        way: float = 0.0,
        gone: float = 0.0,
    ) -> 'Threshold':
        """
        Return the threshold after ``velocity`` was commanded for ``dt`` [s].

        ``position`` is where that led, as it was measured to ``deviation``; nan begins anew, as
        does a command of more than ``most``, or to the other side before the last one was seen.
        None at all is a pause. What a base does first may be what was commanded before.
        """
        side = math.copysign(1.0, velocity) if velocity else self.side
        turns = side * self.side < 0.0 and (self.asked != 0.0 or not self.value)
        if not math.isfinite(deviation) or abs(velocity) > most:
            return Threshold(self.value)
        if turns:
            return Threshold(self.value, stood=self.stood, bend=self.bend)
        lasted = self.lasted + dt if side else 0.0
        idle = 0.0 if velocity else self.idle + dt
        if lasted <= LATE_S or math.isnan(self.origin):
            lasted = min(lasted, LATE_S)
            begun = Threshold(self.value, side, lasted, position, idle=idle)
            return replace(begun, stood=self.stood, bend=self.bend)
        asked, power = self.asked + velocity * dt, self.power + velocity * velocity * dt
        way, gone = self.way + way, self.gone + gone
        sums = {'asked': asked, 'power': power, 'way': way, 'gone': gone}
        after = replace(self, side=side, lasted=lasted, idle=idle, **sums)
        if self.value and idle > LATE_S and abs(asked) < self.value * dt:
            # It stands, and no pulse was sent: where it does is known better with every look.
            origin = self.origin + SMOOTHING * (position - self.origin)
            return replace(after, origin=origin, asked=0.0, power=0.0)
        # Of pulses the last one has to act, or to be one of many.
        many = lasted >= PATIENCE_S and abs(asked) >= MANY * self.value * dt
        has_acted = many or (self.value > 0.0 and idle + dt > LATE_S)
        enough = abs(asked) >= max(LEAST_ASKED, DEVIATIONS * deviation)
        return after._judged(position, dt, most) if enough and has_acted else after

    def _judged(self, position: float, dt: float, most: float) -> 'Threshold':
        """Return the threshold after what was asked has led to ``position``."""
        again = Threshold(self.value, self.side, LATE_S, position, idle=self.idle)
        least = OF_PULSES if self.value else STANDING
        if self.side * (position - self.origin) >= least * abs(self.asked):
            return again
        drives = abs(self.way) > max(CREEPING * self.lasted, MOST_WAY * abs(self.asked))
        if drives and abs(self.gone) < STANDING * abs(self.way):
            return again  # the base is deaf
        usual = self.power / abs(self.asked)  # of those commands, by what they asked for
        bend = (position - self.origin - self.asked) / self.way if self.way else math.inf
        alike = not abs(bend - self.bend) > UNLIKE * max(abs(bend), abs(self.bend))
        again = replace(again, stood=usual, bend=bend)
        if abs(bend) <= MOST_CURVATURE and (alike or not self.stood):
            return again  # unequal wheels undo as much
        if self.value:  # it was seen twice before that pulses are needed
            learnt = MARGIN_AGAIN * usual if LEARNT * self.value <= usual else self.value
        elif self.stood:  # pulses that are too small to be seen would teach nothing
            learnt = max(MARGIN * min(usual, self.stood), LEAST_ASKED / dt)
        else:
            return again
        return replace(again, value=max(self.value, min(learnt, most)), stood=0.0)


@dataclass(frozen=True, slots=True)
class DeadBand:
    """
    Thresholds of the base, [m/s] and [rad/s], as they show while it drives.

    ``along`` is the way of the camera along the robot's own axis [m], to ``place``, (right, ahead)
    of the goal [m], None where no memory of views gives it. There the difference D of the features
    tells it where its slope is known, as the longitudinal error ``seen`` [m], nan elsewhere.
    """

    linear: Threshold = Threshold()
    angular: Threshold = Threshold()
    along: float = 0.0
    place: tuple[float, float] | None = None
    seen: float = math.nan

    def updated(
        self,
        measurement: Measurement,
        reading: MapMeasurement | None,
        twist: Twist,
        dt: float,
        settings: DriveSettings,
        slope: float = 0.0,
    ) -> 'DeadBand':
        """
        Return the dead band after ``twist`` led to a ``measurement`` in ``dt`` [s].

        ``slope`` is that of D [1/m], 0 or less while unknown.
        """
        if not learns(settings):
            return DeadBand()
        along, place, seen, deviation = self.along, None, math.nan, _way_deviation(reading)
        if reading is not None:
            place = reading.lateral, reading.longitudinal
            along += _way(self.place or place, place, reading.heading_error)
        elif slope > 0.0:
            seen = measurement.difference / slope
            deviation = measurement.difference_deviation / slope
            along += seen - self.seen if math.isfinite(seen - self.seen) else 0.0
        return DeadBand(
            self.linear.updated(
                along,
                deviation,
                twist.linear,
                dt,
                most=_most(settings.max_linear, MOST_HOP[0], dt),
            ),
            self.angular.updated(
                self._unwrapped(measurement.heading_error),
                heading_deviation(measurement),
                twist.angular,
                dt,
                way=twist.linear * dt,
                gone=along - self.along,
                most=_most(settings.max_angular, MOST_HOP[1], dt),
            ),
            along,
            place,
            seen,
        )

    def beside(self, settings: SettingsT) -> SettingsT:
        """Return ``settings`` with dead bands at least as wide as those that were learnt."""
        learnt = min(self.linear.value, largest_dead_band(settings.max_linear))
        linear = max(settings.dead_band_linear, learnt)
        learnt = min(self.angular.value, largest_dead_band(settings.max_angular))
        angular = max(settings.dead_band_angular, learnt)
        if (linear, angular) == (settings.dead_band_linear, settings.dead_band_angular):
            return settings
        if not learns(settings):
            return settings
        return with_identified(settings, dead_band_linear=linear, dead_band_angular=angular)

    def _unwrapped(self, heading: float) -> float:
        """Return the heading error nearest to where turns were counted from."""
        origin = self.angular.origin
        if math.isnan(origin):
            return heading
        return origin + math.remainder(heading - origin, 2.0 * math.pi)


def learns(settings: DriveSettings) -> bool:
    """Whether a dead band is learnt: where it would be sent as pulses, which do no harm."""
    return settings.options.learnt_dead_band and settings.dead_band_mode == 'pulse'


def _most(limit: float, hop: float, dt: float) -> float:
    """Return the largest velocity that may be learnt: of the ``limit``, and half a ``hop``."""
    return min(largest_dead_band(limit), 2.0 * hop / dt if dt > 0.0 else math.inf)


def _way(before: tuple[float, float], now: tuple[float, float], heading: float) -> float:
    """Return how far a place moved along the robot's axis [m]: a turn alone moves it nowhere."""
    right, ahead = now[0] - before[0], now[1] - before[1]
    return ahead * math.cos(heading) - right * math.sin(heading)


def _way_deviation(reading: MapMeasurement | None) -> float:
    """Return the deviation of a place from view to view [m]; nan where no memory has one."""
    if reading is None:
        return math.nan
    return math.hypot(reading.own[1], REFINING * math.hypot(reading.lateral, reading.longitudinal))
