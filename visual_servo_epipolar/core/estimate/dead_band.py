"""Dead band: the velocities that a base does not follow, estimated where it stands instead."""

from dataclasses import dataclass, replace
import math

from visual_servo_epipolar.core.estimate.base_model import (
    FIRST_VARIANCE,
    FOLLOWED,
    heading_deviation,
    largest_dead_band,
    MOST_CURVATURE,
    SOON_S,
)
from visual_servo_epipolar.core.estimate.settings import DriveSettings, SettingsT, with_identified
from visual_servo_epipolar.core.geometry.least_squares import CONTRADICTING
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.core.mapping.window import Y
from visual_servo_epipolar.core.odometry.legs import LIKELY
from visual_servo_epipolar.core.twoview.measurement import Measurement

# After that, in which it follows if it does at all; on a way, where wheels may undo a turn.
PATIENCE_S, PATIENCE_ON_WAY_S = 0.3, 1.0
LEAST_ASKED = 0.003  # motion, below which laws and delays make anything of it [m], [rad]
STANDING = 0.5  # of what was commanded: a base that moved less stands, at least now and then
OF_PULSES = 0.15  # the same of pulses, most of which a base may spend on speeding up, and on a way
DISCERNIBLE = 2.0  # pulses, by which wheels of a bend must turn the base, else a dead band may fit
SMOOTHING = 0.2  # weight of the newest position of a standing robot
MANY = 4.0  # pulses, of which one may not have acted yet
MARGIN = 2.5  # over the velocity that was not followed: it may be twenty times as fast that is
MOST_HOP = 0.005, math.radians(0.6)  # half a pulse: no end may be wider for it [m], [rad]
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
    the sum of their squares over time. Before that it ``stood`` below such a velocity: the value
    is then the largest one, until pulses of it have shown what the base does. Metres or radians.

    Wheels of a curvature ``bend`` [rad/m] would have undone the turn on the ``way`` [m]; inf where
    there was none, nan before. They bend the way between pulses as well. Of that way the view
    moved on a part, ``gone``, 0 of a base that is deaf.
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
    bend: float = math.nan

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
        latency: float = 0.0,
        stands: bool = True,
    ) -> 'Threshold':
        """
        Return the threshold after ``velocity`` was commanded for ``dt`` [s].

        ``position`` is where that led, as it was measured to ``deviation``; nan begins anew, as
        does a command of more than ``most``, or to the other side before the last one was seen,
        or a gap between images, in which a command may have been withdrawn, or stamps that leap.
        None at all is a pause. What a base does first may be what was commanded before its
        ``latency`` [s]. Whether it ``stands`` after few pulses tells, unless moves are judged.
        """
        side = math.copysign(1.0, velocity) if velocity else self.side
        turns = side * self.side < 0.0 and (self.asked != 0.0 or not self.value)
        gap = not 0.0 < dt <= SOON_S
        if turns or gap or not math.isfinite(deviation) or abs(velocity) > most:
            return Threshold(self.value, stood=self.stood, bend=self.bend)
        late = max(SOON_S, latency)
        pulses = self.value > 0.0 and stands
        paused = not pulses and self.idle > late  # what came before has acted
        lasted = self.lasted + dt if side and not paused else 0.0
        idle = 0.0 if velocity else self.idle + dt
        if lasted <= late or math.isnan(self.origin):
            begun = Threshold(self.value, side, min(lasted, late), position, idle=idle)
            return replace(begun, stood=self.stood, bend=self.bend)
        asked, power = self.asked + velocity * dt, self.power + velocity * velocity * dt
        sums = {'asked': asked, 'power': power, 'way': self.way + way, 'gone': self.gone + gone}
        after = replace(self, side=side, lasted=lasted, idle=idle, **sums)
        if self.value and idle > late and abs(asked) < self.value * dt:
            # It stands, and no pulse was sent: where it does is known better with every look.
            origin = self.origin + SMOOTHING * (position - self.origin)
            return replace(after, origin=origin, asked=0.0, power=0.0)
        # Of pulses the last one has to act, or to be one of many.
        patience = PATIENCE_ON_WAY_S if after.drives else PATIENCE_S
        many = lasted >= late + patience and abs(asked) >= MANY * self.value * dt
        has_acted = many or (pulses and idle + dt > late)
        enough = abs(asked) >= max(LEAST_ASKED, math.sqrt(CONTRADICTING) / STANDING * deviation)
        tells = not (self.stood and abs(self.bend * after.way) < DISCERNIBLE * self.value * dt)
        return after._judged(position, dt, most) if enough and has_acted and tells else after

    def after_pulses(self, way: float, gone: float, error: float, most: float) -> 'Threshold':
        """Return the threshold, wider if the base has not ``gone`` the ``way`` of its pulses."""
        if gone >= OF_PULSES * way or abs(gone) + LIKELY * error >= STANDING * way:
            return self  # it moved, or was pushed back
        return replace(self, value=max(self.value, min(MARGIN * self.value, most)))

    @property
    def drives(self) -> bool:
        """Whether the robot was to drive meanwhile, farther than slow turns lead."""
        return abs(self.way) > max(CREEPING * self.lasted, MOST_WAY * abs(self.asked))

    def _judged(self, position: float, dt: float, most: float) -> 'Threshold':
        """Return the threshold after what was asked has led to ``position``."""
        again = Threshold(self.value, self.side, SOON_S, position, idle=self.idle, bend=self.bend)
        if self.drives and not self.gone:
            return again  # the base is deaf
        bend = (position - self.origin - self.asked) / self.way if self.way else math.inf
        # Nearer to each other than the larger to none at all.
        alike = 2.0 * abs(bend - self.bend) <= max(abs(bend), abs(self.bend))
        wheels = abs(bend) <= MOST_CURVATURE and alike
        stood = self.stood or self.power / abs(self.asked)
        learnt = min(max(MARGIN * stood, LEAST_ASKED / dt), most)
        if self.stood:  # pulses came since then, that any base follows
            return replace(again, value=0.0 if wheels else learnt, bend=bend)
        part = OF_PULSES if self.value or abs(bend) <= MOST_CURVATURE else STANDING
        wheels = wheels or bend * bend <= FIRST_VARIANCE  # as those of many a base do
        moved = self.side * (position - self.origin) / abs(self.asked)
        pushed = moved <= -STANDING and abs(bend) > MOST_CURVATURE  # by a hand: no wheels do
        if wheels or pushed or moved >= part:
            return again
        if self.value or abs(bend) > MOST_CURVATURE:
            return replace(again, value=max(self.value, learnt))
        return Threshold(most, self.side, stood=stood, bend=bend)


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
        reading: MapLocalization | None,
        twist: Twist,
        dt: float,
        settings: DriveSettings,
        slope: float = 0.0,
        view_moves: bool = True,
    ) -> 'DeadBand':
        """
        Return the dead band after ``twist`` led to a ``measurement`` in ``dt`` [s].

        ``slope`` is that of D [1/m], 0 or less while unknown; a base that drives ``view_moves``.
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
        most, turn_most = _most(settings, dt)
        late = settings.latency
        # Where it stands, moves tell: see ``after_move``.
        linear = self.linear.updated(
            along, deviation, twist.linear, dt, most=most, latency=late, stands=False
        )
        angular = self.angular.updated(
            self._unwrapped(measurement.heading_error),
            heading_deviation(measurement),
            twist.angular,
            dt,
            way=twist.linear * dt,
            gone=abs(twist.linear) * dt if view_moves else 0.0,
            most=turn_most,
            latency=late,
        )
        linear, angular = _shared(linear, angular, (most, turn_most), settings)
        return DeadBand(linear, angular, along, place, seen)

    def after_move(
        self, way: float, gone: float, error: float, dt: float, settings: DriveSettings
    ) -> 'DeadBand':
        """
        Return the dead band after pulses for a ``way``, of which so much was ``gone`` [m].

        ``error`` is that of the positions between which it went [m].
        """
        most, _ = _most(settings, dt)
        return replace(self, linear=self.linear.after_pulses(way, gone, error, most))

    def after_turn(
        self, way: float, gone: float, error: float, dt: float, settings: DriveSettings
    ) -> 'DeadBand':
        """Return the dead band after pulses for a turn, likewise [rad]."""
        _, most = _most(settings, dt)
        return replace(self, angular=self.angular.after_pulses(way, gone, error, most))

    def assumed(self, dt: float, settings: DriveSettings) -> 'DeadBand':
        """Return the dead band, a small one at least: slower motions lead back and forth."""
        if self.linear.value or settings.dead_band_linear:
            return self
        linear, angular = (min(LEAST_ASKED / dt, most) for most in _most(settings, dt))
        return replace(
            self,
            linear=replace(self.linear, value=linear),
            angular=replace(self.angular, value=self.angular.value or angular),
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


def _shared(
    linear: Threshold, angular: Threshold, most: tuple[float, float], settings: DriveSettings
) -> tuple[Threshold, Threshold]:
    """Return both thresholds: what has one dead band has both, of at ``most`` [m/s, rad/s]."""
    if angular.value and not (angular.stood or linear.value or settings.dead_band_linear):
        # Its wheels have a lever of less than a metre.
        linear = replace(linear, value=min(angular.value, FOLLOWED, most[0]))
    elif linear.value and not (angular.value or settings.dead_band_angular):
        angular = replace(angular, value=most[1])
    return linear, angular


def learns(settings: DriveSettings) -> bool:
    """Whether a dead band is learnt: where it would be sent as pulses, which do no harm."""
    return settings.options.learnt_dead_band and settings.dead_band_mode == 'pulse'


def _most(settings: DriveSettings, dt: float) -> tuple[float, float]:
    """Return the largest velocities that may be learnt [m/s, rad/s]: of the limits, and hops."""
    linear, angular = (2.0 * hop / dt if dt > 0.0 else math.inf for hop in MOST_HOP)
    return (
        min(largest_dead_band(settings.max_linear), linear),
        min(largest_dead_band(settings.max_angular), angular),
    )


def _way(before: tuple[float, float], now: tuple[float, float], heading: float) -> float:
    """Return how far a place moved along the robot's axis [m]: a turn alone moves it nowhere."""
    right, ahead = now[0] - before[0], now[1] - before[1]
    return ahead * math.cos(heading) - right * math.sin(heading)


def _way_deviation(reading: MapLocalization | None) -> float:
    """Return the deviation of a place from view to view [m]; nan where no memory has one."""
    if reading is None:
        return math.nan
    return math.hypot(math.sqrt(reading.own[Y, Y]), REFINING * reading.distance)
