"""
Map state: what the keyframes of the way say of this view, where they know better than two.

Where the robot is near the goal is averaged over views by what it drove: the pose filter.
"""

from dataclasses import dataclass, replace
import math
from typing import Any

import numpy as np

from visual_servo_epipolar.core.arrays import are_among, FloatArray, IntArray, ROUNDING
from visual_servo_epipolar.core.estimate.extrinsics import DIRECTION
from visual_servo_epipolar.core.estimate.settings import DriveSettings
from visual_servo_epipolar.core.geometry.least_squares import CONTRADICTING
from visual_servo_epipolar.core.mapping.keyframe_map import KeyframeMap
from visual_servo_epipolar.core.mapping.localization import (
    difference_slope,
    MapLocalization,
)
from visual_servo_epipolar.core.mapping.window import (
    FeatureObservations,
    HEADING,
    MapSettings,
)
from visual_servo_epipolar.core.odometry.increments import Motion, OdometryIncrement
from visual_servo_epipolar.core.reasons import Reason
from visual_servo_epipolar.core.twoview.estimator import Attitude
from visual_servo_epipolar.core.twoview.measurement import Measurement
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.perceive import of_few, Perception, with_difference

# Unknowns: the place, right and ahead [m], and heading error [rad]; the share of a way that leads
# to the side, as a camera may look elsewhere than where the base drives.
PLACE = HEADING + 1
SLIP, UNKNOWNS = PLACE, PLACE + 1
SLIP_WALK = 0.02  # change of that share after a metre
TURN_OF_WAY, ASIDE = 0.1, 0.003  # turn that a way may add [rad/m], and what it leads aside by
LEAST = ROUNDING**2 * np.eye(PLACE)
IDENTITY = np.eye(UNKNOWNS)
PREFERENCE = 3.0  # deviations of two views that one of the memory may have
# Of views that show too little for two: what must agree with one place, which is where they drove.
LEAST_CARRIED, CARRIED_SHARE = 6, 0.6
BY_COMMANDS = MapSettings()


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
    covariance = np.diag([0.0] * PLACE + [DIRECTION**2])
    covariance[:PLACE, :PLACE] = own
    return FilteredPose(np.append(mean, 0.0), covariance, decayed_motion)


def filter_pose(
    said: MapLocalization, place: FilteredPose | None, motion: Motion
) -> tuple[MapLocalization, FilteredPose]:
    """Return a recollection averaged with those before it, and the place for the next."""
    mean, own = said.pose[:PLACE] - said.shift[:PLACE], said.own[:PLACE, :PLACE] + LEAST
    if place is None:
        return said, first_pose(mean, own, Motion(abs(motion.way), abs(motion.turn)))
    before = place.after(motion)
    change = _change(said, before)
    both = np.empty((PLACE, UNKNOWNS + 1))
    both[:, :UNKNOWNS], both[:, UNKNOWNS] = before.covariance[:PLACE], change
    shares = np.linalg.solve(before.covariance[:PLACE, :PLACE] + own, both)
    gain = shares[:, :UNKNOWNS].T
    if change @ shares[:, UNKNOWNS] > CONTRADICTING:
        return said, first_pose(mean, own, before.decayed_motion)
    known = before.covariance - gain @ before.covariance[:PLACE]
    known = 0.5 * (known + known.T)
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
    return float(change @ np.linalg.solve(covariance, change)) <= CONTRADICTING


def _change(said: MapLocalization, place: FilteredPose) -> FloatArray:
    """Return where a recollection is, (3,), less a ``place``."""
    change = said.pose[:PLACE] - said.shift[:PLACE] - place.mean[:PLACE]
    change[HEADING] = math.remainder(change[HEADING], 2.0 * math.pi)
    return np.asarray(change)


@dataclass(frozen=True, slots=True, eq=False)
class MapState:
    """
    The memory of ``views``, and the ``place`` that they were averaged to; None without one.

    ``few_s`` is how long too few features have been in view for two views, less how long enough
    have been since [s]; ``is_over`` whether that alone keeps the memory from carrying on.
    """

    views: KeyframeMap | None = None
    place: FilteredPose | None = None
    few_s: float = 0.0
    is_over: bool = False

    def update_map(self) -> 'MapState':
        """Return what is remembered after the views have learnt from the last one."""
        views = None if self.views is None else self.views.update_map()
        if views is self.views:
            return self
        return MapState(views, self.place, self.few_s, self.is_over)


def localize(
    before: MapState,
    perception: Perception,
    increment: OdometryIncrement,
    settings: DriveSettings,
    *,
    dt: float = 0.0,
    encoder_noise: float = 0.0,
) -> tuple[MapState, MapLocalization | None]:
    """
    Return the memory ``dt`` [s] after the last view, and what it reads of this; None if nothing.

    The heading that a head's encoder tells is wrong by its ``encoder_noise`` [rad] in each view.

    The ``increment`` driven since the last view gives the scale. A lens that is being learnt
    would move the rays that keyframes hold: with one nothing is remembered.
    """
    seen, motion = perception.observation, increment.motion
    if not settings.remembers:
        return MapState(), None
    bounds = settings.map_by_wheels if increment.trusted else BY_COMMANDS
    views = _views_of(before.views, perception.memory.mount_by(settings), bounds)
    if views is not before.views:
        before = replace(before, place=None)  # it was of another scale, or floor
    if seen is None or seen.ids is None:
        return MapState(views), None
    is_few = perception.measurement.features < settings.min_features
    few_s = max(before.few_s + (dt if is_few else -dt), 0.0)
    few_s = min(few_s, settings.few_features_timeout)
    noise = np.maximum(perception.memory.noise * seen.resolution, ROUNDING)
    observations = FeatureObservations(seen.ids, seen.current, seen.desired, noise)
    after, said = _localized(views, observations, perception, increment, learns=not is_few)
    if is_few:
        is_over = few_s >= settings.few_features_timeout
        carries = _carries(said, observations.ids, before.place, motion)
        if is_over or not carries:
            place = None if before.place is None else before.place.after(motion)
            # A pose that contradicts the driven path is discarded.
            unseen = replace(after, pose=views.pose, shrinkage=views.shrinkage)
            is_over = is_over and (carries or before.is_over)  # the cause, also of what follows
            return MapState(unseen, place, few_s, is_over), None
    if said is None:
        return MapState(after, None, few_s), None
    if seen.head is not None:
        said = with_heading_noise(said, encoder_noise)
    said, place = filter_pose(said, before.place, motion)
    return MapState(after, place, few_s), with_slope(said, seen)


def _views_of(views: KeyframeMap | None, mount: Attitude, bounds: MapSettings) -> KeyframeMap:
    """Return the map by the motion that counts, and on the floor as rough as it has become."""
    if views is None:
        return KeyframeMap(mount, bounds)
    if views.mount.jitter < mount.jitter:
        views = views.with_mount(mount)
    return views if views.settings == bounds else views.with_alternative(bounds)


def _localized(
    views: KeyframeMap,
    observations: FeatureObservations,
    perception: Perception,
    increment: OdometryIncrement,
    *,
    learns: bool,
) -> tuple[KeyframeMap, MapLocalization | None]:
    measurement, motion, other = perception.measurement, increment.motion, increment.other
    bearings = () if measurement.bearings is None else (measurement.bearings,)
    return views.after(
        observations,
        motion.chord,
        alternative_motion=None if other is motion else other.chord,
        bearings=measurement.rivals or bearings,
        attitude=perception.memory.attitude,
        learns=learns,
    )


def _carries(
    said: MapLocalization | None, ids: IntArray, place: FilteredPose | None, motion: Motion
) -> bool:
    """Return whether few features, of ``ids`` (N,), show the robot where it has driven to."""
    if said is None or place is None:
        return False
    known = are_among(ids, said.geometry.window.ids[said.geometry.trusted])
    if int(said.inliers.sum()) < max(LEAST_CARRIED, CARRIED_SHARE * int(known.sum())):
        return False
    return agrees(said, place.after(motion))


def measurement_of(
    perception: Perception,
    reading: MapLocalization | None,
    after: MapState,
    settings: DriveSettings,
) -> Measurement:
    """Return the measurement of a view, by two views, or by what is remembered ``after`` it."""
    measurement = perception.measurement
    if measurement.features >= settings.min_features or not settings.remembers:
        if reading is None:
            return with_difference(perception, settings)
        return sharpened(measurement, reading, settings)
    if reading is not None:
        few = replace(of_few(perception, settings), carried=True)
        return sharpened(few, reading, settings)
    if not after.is_over or settings.few_features_timeout == 0.0:
        return measurement
    over = Reason.MEMORY_OVER.of(measurement.reason, settings.few_features_timeout)
    return replace(measurement, reason=over)


def sharpened(
    measurement: Measurement, reading: MapLocalization, settings: DriveSettings
) -> Measurement:
    """
    Return ``measurement`` with what the memory measures better, by deviations.

    Of two that know a bearing about as well it is the memory's: two views do not know how wrong
    the lens is, and where now the one and then the other counts, bearings leap.
    """
    bearings: dict[str, Any] = {}
    before = measurement.deviation if measurement.bearings is not None else math.inf
    most = min(PREFERENCE * before, settings.max_deviation)
    if reading.bearings is not None and reading.bearings_deviation < most:
        bearings = {
            'bearings': reading.bearings,
            'deviation': reading.bearings_deviation,
            'covariance': reading.bearings_covariance,
            'confidence': 1.0,  # features lie ahead in all views together
            'inliers': int(np.count_nonzero(reading.inliers)),
            'remembered': True,
            'rivals': (),
            'reason': '',
        }
    return replace(
        measurement,
        **bearings,
        heading_error=reading.heading_error,
        rotation_heading=reading.heading_error,
        difference=reading.difference,
        difference_deviation=reading.difference_slope * reading.longitudinal_deviation,
        difference_slope=reading.difference_slope,
        offset=(reading.lateral, reading.longitudinal),
        offset_deviation=math.hypot(reading.lateral_deviation, reading.longitudinal_deviation),
        heading_deviation=reading.heading_deviation,
    )


def with_slope(said: MapLocalization, observation: Observation) -> MapLocalization:
    """Return what is said, with D over features in view, or over all where none of them is."""
    window, counted = said.geometry.window, said.geometry.trusted
    if observation.ids is not None:
        in_view = counted & are_among(window.ids, observation.ids)
        counted = in_view if in_view.any() else counted
    near = said.geometry.unknowns.inverse_depth[counted]
    slope = difference_slope(window.photograph[counted], near, wide=observation.wide)
    return replace(said, difference_slope=slope)
