"""
Keyframe map: from one view to the next.

Until a geometry is found, views are collected; from then on each view is localized in it, and
becomes a keyframe where it shows what the others do not. No observation counts twice: a view is
localized in the map of those before it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.mapping.fitting import (
    anchors_of,
    fit_pose_near,
    MatchedFeatures,
    NOTHING,
    resect,
    Shrinkage,
)
from visual_servo_epipolar.core.mapping.initialization import (
    initial_geometry,
    is_sound,
    LEAST_AGREEING,
    Start,
)
from visual_servo_epipolar.core.mapping.localization import localization_of, MapLocalization
from visual_servo_epipolar.core.mapping.refinement import Geometry, refine, rescale
from visual_servo_epipolar.core.mapping.selection import (
    Bootstrap,
    is_keyframe,
    obstacle,
    PendingKeyframe,
    with_keyframe,
)
from visual_servo_epipolar.core.mapping.window import (
    EMPTY,
    FeatureObservations,
    HEADING,
    KeyframeWindow,
    MapSettings,
    tangent_basis_of,
)
from visual_servo_epipolar.core.twoview.estimator import Attitude

MIN_AGREEING = 5  # of features of the map that agree
MOST_REFUSED = 3  # keyframes in a row that do not fit: then the geometry is wrong, not they


@dataclass(frozen=True, eq=False)
class KeyframeMap:
    """
    Map of keyframes and features; a new photograph needs a new map.

    ``mount`` is the belief of the camera's attitude; ``window`` the keyframes, ``geometry`` their
    geometry once there is one, for which ``bootstrap`` collects views; ``places``, (2, 2), where
    the camera is by the motion that counts and by the alternative [m]; ``pose``, (5,), that of the
    last view. ``refused`` counts keyframes in a row with which the geometry was unsound.
    ``pending`` is the last view that was localized, until the map is updated with it: no
    localization waits for that.
    """

    mount: Attitude
    settings: MapSettings = MapSettings()
    window: KeyframeWindow = EMPTY
    geometry: Geometry | None = None
    bootstrap: Bootstrap = Bootstrap()
    places: FloatArray = field(default_factory=lambda: np.zeros((2, 2)))
    pose: FloatArray | None = None
    refused: int = 0
    shrinkage: Shrinkage = NOTHING
    pending: PendingKeyframe | None = None

    def with_alternative(self, settings: MapSettings) -> 'KeyframeMap':
        """Return the same map by the alternative motion: at another scale."""
        before = self.update_map()
        other = replace(
            before,
            settings=settings,
            window=before.window.with_alternative,
            places=before.places[::-1],
        )
        if before.geometry is None:
            return other
        geometry, ratio = rescale(before.geometry, other.window, settings)
        if before.pose is None:
            return replace(other, geometry=geometry)
        pose = np.concatenate([ratio * before.pose[:HEADING], before.pose[HEADING:]])
        return replace(other, geometry=geometry, pose=pose)

    def with_mount(self, mount: Attitude) -> 'KeyframeMap':
        """Return the same map of a camera with another ``mount``, or on a rougher floor."""
        before = self.update_map()
        if before.geometry is None:
            return replace(before, mount=mount)
        at, steps = before.geometry.evaluation, self.settings.steps
        start = replace(at, factors=replace(at.factors, mount=mount))
        geometry = refine(start, steps, before.geometry.damping)
        return replace(before, mount=mount, geometry=geometry)

    @property
    def wrong(self) -> tuple[int, ...]:
        """The ids of wrong matches, of the features of the map."""
        if self.geometry is None:
            return ()
        return tuple(self.geometry.wrong.tolist())

    def after(
        self,
        observations: FeatureObservations,
        motion: FloatArray | None = None,
        *,
        alternative_motion: FloatArray | None = None,
        bearings: Sequence[Bearings] = (),
        attitude: Attitude | None = None,
        learns: bool = True,
    ) -> 'tuple[KeyframeMap, MapLocalization]':
        """
        Return the map after one more view, yet to be updated with it, and its localization.

        ``motion``, (2,), is the way of the camera since the last view, right and ahead in its axes
        then [m], nan where unknown: it counts for the scale alone; ``alternative_motion`` the
        same by the other source. ``bearings`` are those of photograph and view, needed to begin
        with, ``attitude`` that of the camera as known by now. A view that does not learn is
        localized alone.
        """
        before = self.update_map()
        heading = 0.0 if before.pose is None else float(before.pose[2])
        way = _turned(np.zeros(2) if motion is None else motion, heading)
        other = way if alternative_motion is None else _turned(alternative_motion, heading)
        after = replace(before, places=before.places + [way, other])
        if after.geometry is not None:
            return after._localize(after.geometry, observations, learns)
        if not learns:
            return after, MapLocalization('nothing is remembered to hold the view against')
        return after._begin(observations, bearings, attitude or self.mount)

    def update_map(self) -> 'KeyframeMap':
        """Return the map with what the last view adds: the first geometry, or a better one."""
        if self.bootstrap.is_due:
            after = self._initialize()
        elif self.pending is not None and self.geometry is not None:
            after = replace(self, pending=None)._with_keyframe(self.geometry, self.pending)
        else:
            return self
        if after.geometry is not None:
            after.geometry.prepare()
        return after

    def _begin(
        self, observations: FeatureObservations, bearings: Sequence[Bearings], attitude: Attitude
    ) -> 'tuple[KeyframeMap, MapLocalization]':
        """Return the map with one more view to begin with."""
        reason = obstacle(observations, bearings)
        if reason:
            return self, MapLocalization(reason)
        pose = np.array([0.0, 0.0, bearings[0].heading_error, attitude.tilt, attitude.roll])
        if self.bootstrap.is_like_last(observations):
            reason = 'views are too alike to begin with'
            return replace(self, pose=pose), MapLocalization(reason)
        starts = [Start(0, each, attitude) for each in bearings]
        bootstrap, window = self.bootstrap.with_view(
            self.window, observations, self.places, starts, most=self.settings.features
        )
        reason = 'one view is collected, two are needed'
        if bootstrap.is_due:
            reason = 'the geometry may begin with this view'
        after = replace(self, pose=pose, window=window, bootstrap=bootstrap)
        return after, MapLocalization(reason)

    def _initialize(self) -> 'KeyframeMap':
        """Return the map with the first geometry, if one fits the views to begin with."""
        starts = self.bootstrap.starts
        geometry = initial_geometry(self.window, starts, self.mount, self.settings)
        if geometry is None:
            return replace(self, bootstrap=self.bootstrap.done)
        pose = geometry.unknowns.views[-1]
        return replace(self._with(geometry), bootstrap=Bootstrap(), pose=pose)

    def _localize(
        self, geometry: Geometry, observations: FeatureObservations, learns: bool
    ) -> 'tuple[KeyframeMap, MapLocalization]':
        """Return the map after a view that is localized in its geometry."""
        rows = geometry.window.rows_of(observations.ids)
        known = rows >= 0
        known[known] = geometry.trusted[rows[known]]
        count = int(known.sum())
        if count < MIN_AGREEING:
            reason = f'{count} remembered features in view, {MIN_AGREEING} needed'
            return self, MapLocalization(reason, ids=self.window.ids)
        rays, noise = observations.current[known], observations.noise[known, 0]
        seen = MatchedFeatures(rows[known], rays.T, tangent_basis_of(rays, noise))
        anchors = anchors_of(geometry).of(seen.rows)
        fit = fit_pose_near(geometry.unknowns.views, anchors, seen, self.pose)
        agree = int(fit.inliers.sum())
        if agree < max(MIN_AGREEING, LEAST_AGREEING * count):
            reason = f'{agree} of {count} remembered features agree with one place'
            return self, MapLocalization(reason, ids=self.window.ids)
        shrinkage = self.shrinkage.before(float(np.hypot(*fit.pose[:2])), geometry.depth)
        resection = resect(geometry, anchors, seen, fit, shrinkage)
        new = int((rows < 0).sum())
        after = replace(
            self,
            pose=resection.pose,
            shrinkage=resection.shrinkage,
            pending=PendingKeyframe(observations, resection.pose, new) if learns else None,
        )
        return after, localization_of(resection, geometry, known)

    def _with_keyframe(self, geometry: Geometry, view: PendingKeyframe) -> 'KeyframeMap':
        """Return the map with the view as a keyframe where it is one, or refined."""
        settings, observations, pose = self.settings, view.observations, view.pose
        if is_keyframe(
            geometry,
            pose,
            observations=len(observations),
            new=view.new,
            settings=settings,
        ):
            start = with_keyframe(geometry, observations, self.places, pose, settings)
            return self._with_sound(refine(start, settings.steps, geometry.damping))
        if geometry.converged:
            return self
        return self._with(refine(geometry.evaluation, 1, geometry.damping, geometry.system))

    def _with_sound(self, geometry: Geometry) -> 'KeyframeMap':
        """Return the map by a geometry with a keyframe more, unless that makes it unsound."""
        if is_sound(geometry):
            return replace(self._with(geometry), refused=0)
        if self.refused + 1 < MOST_REFUSED:
            return replace(self, refused=self.refused + 1)
        return KeyframeMap(self.mount, self.settings, places=self.places)

    def _with(self, geometry: Geometry) -> 'KeyframeMap':
        return replace(self, window=geometry.window, geometry=geometry)


def _turned(motion: FloatArray, heading: float) -> FloatArray:
    """Return a motion, right and ahead, in axes of the photograph."""
    cosine, sine = np.cos(heading), np.sin(heading)
    right, ahead = motion
    return np.array([cosine * right - sine * ahead, sine * right + cosine * ahead])
