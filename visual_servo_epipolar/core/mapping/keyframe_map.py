"""
Keyframe map: from one view to the next.

Until a geometry is found, views are collected; from then on each view is localized in it, and
becomes a keyframe where it shows what the others do not. No observation counts twice: a view is
localized in the map of those before it. Of too many, the keyframe in the crowd and the features
that are seen least are let go.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, ROUNDING
from visual_servo_epipolar.core.geometry.epipolar import Bearings, MIN_MATCHES
from visual_servo_epipolar.core.mapping.factors import factors_of
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
    triangulate,
)
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.core.mapping.refinement import Evaluation, Geometry, refine, rescale
from visual_servo_epipolar.core.mapping.window import (
    differ_in_place,
    EMPTY,
    FeatureObservations,
    HEADING,
    KeyframeWindow,
    MapSettings,
    tangent_basis_of,
    Unknowns,
    VIEW,
    X,
    Y,
)
from visual_servo_epipolar.core.twoview.estimator import Attitude

NEW_SHARE = 0.1  # of the observations of a view that are of features not in the map
CLOSEST = 1e-3  # distance that keyframes count as apart at least, in depths of the scene
MOST_VIEWS = 4  # to begin with: more cost more time, and are passed soon
MOST_REFUSED = 3  # keyframes in a row that do not fit: then the geometry is wrong, not they


@dataclass(frozen=True, slots=True, eq=False)
class Bootstrap:
    """
    Views to begin with, in a ``window``, and what pairs tell of them (``starts``).

    ``last`` is the last one; a geometry ``is_due`` or not.
    """

    window: KeyframeWindow = EMPTY
    starts: tuple[Start, ...] = ()
    last: FeatureObservations | None = None
    is_due: bool = False

    def with_view(
        self,
        observations: FeatureObservations,
        place: FloatArray,
        starts: Sequence[Start],
        most: int,
    ) -> 'Bootstrap':
        """Return the bootstrap with a view more, driven to a ``place``, (2,) [m]."""
        window, before = self.window, self.starts
        if len(window) >= MOST_VIEWS:
            window = window.without_view(0)
            before = tuple(each._replace(view=each.view - 1) for each in before if each.view > 0)
        here = tuple(start._replace(view=len(window)) for start in starts)
        window = window.with_view(observations, place)
        kept = kept_features(window, np.ones(len(window.ids), bool), most)
        window = window.of_features(kept)
        return Bootstrap(window, (*before, *here), observations, is_due=len(window) > 1)


@dataclass(frozen=True, eq=False)
class KeyframeMap:
    """
    Map of keyframes and features; a new photograph needs a new map.

    ``mount`` is the belief of the camera's attitude; ``geometry`` that of the keyframes once there
    is one, for which ``bootstrap`` collects views; ``place``, (2,), where the camera is by the
    motion that counts, and ``ways``, (2,), how far it has driven by that and by the alternative
    [m]; ``pose``, (5,), that of the last view. ``trial`` is the geometry with one more keyframe,
    half refined: the next view is still localized without it. ``refused`` counts unsound trials in
    a row. ``pending`` is what the last view showed that was localized, until the map is updated
    with it: no localization waits for that.
    """

    mount: Attitude
    settings: MapSettings = MapSettings()
    geometry: Geometry | None = None
    bootstrap: Bootstrap = Bootstrap()
    place: FloatArray = field(default_factory=lambda: np.zeros(2))
    ways: FloatArray = field(default_factory=lambda: np.zeros(2))
    pose: FloatArray | None = None
    trial: Geometry | None = None
    refused: int = 0
    shrinkage: Shrinkage = NOTHING
    pending: FeatureObservations | None = None

    @property
    def window(self) -> KeyframeWindow:
        """The keyframes, or the views to begin with."""
        return self.bootstrap.window if self.geometry is None else self.geometry.window

    def with_alternative(self, settings: MapSettings) -> 'KeyframeMap':
        """Return the same map by the alternative motion: at another scale."""
        before = self.update_map()
        way, other_way = before.ways.tolist()
        longer = other_way / way if min(way, other_way) > ROUNDING else 1.0
        driven_places = longer * before.window.driven_places
        window = replace(before.window, driven_places=driven_places)
        place, ways = longer * before.place, before.ways[::-1]
        other = replace(before, settings=settings, trial=None, place=place, ways=ways)
        if before.geometry is None:
            return replace(other, bootstrap=replace(before.bootstrap, window=window))
        geometry, ratio = rescale(before.geometry, window, settings)
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
        return replace(before, mount=mount, geometry=geometry, trial=None)

    @property
    def wrong(self) -> tuple[int, ...]:
        """The ids of wrong matches, of the features of the map."""
        return () if self.geometry is None else tuple(self.geometry.wrong.tolist())

    def after(
        self,
        observations: FeatureObservations,
        motion: FloatArray | None = None,
        *,
        alternative_motion: FloatArray | None = None,
        bearings: Sequence[Bearings] = (),
        attitude: Attitude | None = None,
        learns: bool = True,
    ) -> 'tuple[KeyframeMap, MapLocalization | None]':
        """
        Return the map after one more view, yet to be updated with it, and its localization.

        None where there is no geometry yet, or too few of its features agree with one place.

        ``motion``, (2,), is the way of the camera since the last view, right and ahead in its axes
        then [m], nan where unknown: it counts for the scale alone; ``alternative_motion`` the
        same by the other source. ``bearings`` are those of photograph and view, needed to begin
        with, ``attitude`` that of the camera as known by now. A view that does not learn is
        localized alone.
        """
        before = self.update_map()
        heading = 0.0 if before.pose is None else float(before.pose[2])
        motion = np.zeros(2) if motion is None else motion
        other = motion if alternative_motion is None else alternative_motion
        after = replace(
            before,
            place=before.place + _turned(motion, heading),
            ways=before.ways + np.hypot(*np.transpose([motion, other])),
        )
        if after.geometry is not None:
            return after._localize(after.geometry, observations, learns)
        if learns and bearings and len(observations) >= MIN_MATCHES:
            after = after._begin(observations, bearings, attitude or self.mount)
        return after, None

    def update_map(self) -> 'KeyframeMap':
        """Return the map with what the last view adds: the first geometry, or a better one."""
        views = self.bootstrap
        if views.is_due:
            geometry = initial_geometry(views.window, views.starts, self.mount, self.settings)
            if geometry is None:
                return replace(self, bootstrap=replace(views, is_due=False))
            pose = geometry.unknowns.views[-1]
            after = replace(self, geometry=geometry, bootstrap=Bootstrap(), pose=pose)
        elif self.pending is not None and self.geometry is not None and self.pose is not None:
            after = replace(self, pending=None)._updated(self.geometry, self.pending, self.pose)
        else:
            return self
        if after.geometry is not None:
            after.geometry.prepare()
        return after

    def _begin(
        self, observations: FeatureObservations, bearings: Sequence[Bearings], attitude: Attitude
    ) -> 'KeyframeMap':
        """Return the map with one more view to begin with, unless it is as the last."""
        pose = np.array([0.0, 0.0, bearings[0].heading_error, attitude.tilt, attitude.roll])
        last, bootstrap = self.bootstrap.last, self.bootstrap
        if last is None or differ_in_place(last, observations):
            starts = [Start(0, each, attitude) for each in bearings]
            most = self.settings.features
            bootstrap = bootstrap.with_view(observations, self.place, starts, most)
        return replace(self, pose=pose, bootstrap=bootstrap)

    def _localize(
        self, geometry: Geometry, observations: FeatureObservations, learns: bool
    ) -> 'tuple[KeyframeMap, MapLocalization | None]':
        """Return the map after a view that is localized in its geometry."""
        rows = geometry.window.rows_of(observations.ids)
        known = rows >= 0
        known[known] = geometry.trusted[rows[known]]
        count = int(known.sum())
        if count < VIEW:  # fewer features than unknowns
            return self, None
        rays, noise = observations.current[known], observations.noise[known, 0]
        seen = MatchedFeatures(rows[known], rays.T, tangent_basis_of(rays, noise))
        anchors = anchors_of(geometry).of(seen.rows)
        fit = fit_pose_near(geometry.unknowns.views, anchors, seen, self.pose)
        if int(fit.inliers.sum()) < max(VIEW, LEAST_AGREEING * count):
            return self, None
        shrinkage = self.shrinkage.before(float(np.hypot(*fit.pose[:2])), geometry.depth)
        reading, shrinkage = resect(geometry, anchors, seen, fit, shrinkage)
        pending = observations if learns else None
        after = replace(self, pose=reading.pose, shrinkage=shrinkage, pending=pending)
        known[known] = reading.inliers
        return after, replace(reading, inliers=known)

    def _updated(
        self, geometry: Geometry, observations: FeatureObservations, pose: FloatArray
    ) -> 'KeyframeMap':
        """Return the map with a view at ``pose`` as a keyframe where it is one, or refined."""
        settings, count = self.settings, len(observations)
        if self.trial is not None:
            return self._with_trial(self.trial)
        new = int((geometry.window.rows_of(observations.ids) < 0).sum())
        if is_keyframe(geometry, pose, observations=count, new=new, settings=settings):
            start = with_keyframe(geometry, observations, self.place, pose, settings)
            return replace(self, trial=refine(start, settings.steps // 2, geometry.damping))
        if geometry.converged:
            return self
        more = refine(geometry.evaluation, 1, geometry.damping, geometry.system)
        return replace(self, geometry=more)

    def _with_trial(self, trial: Geometry) -> 'KeyframeMap':
        """Return the map with a keyframe more, unless the geometry is unsound with it."""
        steps = self.settings.steps - self.settings.steps // 2
        if not trial.converged:
            trial = refine(trial.evaluation, steps, trial.damping)
        if is_sound(trial):
            return replace(self, geometry=trial, trial=None, refused=0)
        if self.refused + 1 < MOST_REFUSED:
            return replace(self, trial=None, refused=self.refused + 1)
        return KeyframeMap(self.mount, self.settings, place=self.place, ways=self.ways)


def _turned(motion: FloatArray, heading: float) -> FloatArray:
    """Return a motion, right and ahead, in axes of the photograph."""
    cosine, sine = np.cos(heading), np.sin(heading)
    right, ahead = motion
    return np.array([cosine * right - sine * ahead, sine * right + cosine * ahead])


def is_keyframe(
    geometry: Geometry, pose: FloatArray, *, observations: int, new: int, settings: MapSettings
) -> bool:
    """
    Whether a view at ``pose`` tells what others do not: from elsewhere, or of new features.

    New ones must find room. Near the photograph they have no depth: a wrong match may be anywhere
    there, and a hand's breadth before the camera it would outweigh all others.
    """
    if observations < MIN_MATCHES:
        return False
    offset = geometry.unknowns.views[:, :2] - pose[:2]
    least = settings.keyframe_spacing * geometry.depth
    if float(np.hypot(offset[:, 0], offset[:, 1]).min()) > least:
        return True
    enough = NEW_SHARE * observations
    if new < enough or not math.hypot(pose[X], pose[Y]) > least:
        return False
    settled = int(((geometry.window.seen.sum(0) > 1) & geometry.trusted).sum())
    return settings.features - settled >= enough


def most_crowded(places: FloatArray, seen: BoolArray, depth: float) -> int:
    """Return the keyframe, but the newest, that tells least: near to others, or few features."""
    offset = (places[:, None] - places) / depth
    square = (offset * offset).sum(-1) + CLOSEST**2
    np.fill_diagonal(square, np.inf)
    share = seen.sum(1) / max(seen.sum(1).max(), 1)
    crowding = (1.0 / square).sum(1) / np.maximum(share, 1e-3) ** 2
    return int(crowding[:-1].argmax())


def kept_features(window: KeyframeWindow, trusted: BoolArray, most: int) -> BoolArray:
    """Return which features are kept, (N,): those in view of a keyframe, the most seen first."""
    count = window.seen.sum(0)
    kept = np.asarray(count > 0)
    if int(kept.sum()) <= most:
        return kept
    rank = np.lexsort((-np.arange(len(count)), count * trusted, kept))
    best = np.zeros(len(count), bool)
    best[rank[-most:]] = True
    return np.asarray(best & kept)


def with_keyframe(
    geometry: Geometry,
    observations: FeatureObservations,
    place: FloatArray,
    pose: FloatArray,
    settings: MapSettings,
) -> Evaluation:
    """Return the window with one more keyframe at ``pose``, and with what is too much let go."""
    before, trusted = geometry.unknowns, geometry.trusted
    window = geometry.window.with_view(observations, place)
    more = len(window.ids) - len(trusted)
    rescaled = geometry.window.photograph_noise / window.photograph_noise[: len(trusted)]
    unknowns = Unknowns(
        np.vstack([before.views, pose]),
        before.shared,
        np.concatenate([rescaled * before.offsets, np.zeros((2, more))], axis=1),
        np.concatenate([before.inverse_depth, np.zeros(more)]),
    )
    if more:
        near = triangulate(window, unknowns, np.arange(len(window)) == len(window) - 1)
        near[: len(trusted)] = before.inverse_depth
        unknowns = replace(unknowns, inverse_depth=near)
    trusted = np.concatenate([trusted, np.ones(more, bool)])
    if len(window) > settings.keyframes:
        k = most_crowded(unknowns.views[:, :2], window.seen & trusted, geometry.depth)
        window = window.without_view(k)
        unknowns = replace(unknowns, views=np.delete(unknowns.views, k, axis=0))
    kept = kept_features(window, trusted, settings.features)
    if not kept.all():
        window, trusted = window.of_features(kept), trusted[kept]
        unknowns = unknowns.of_features(kept)
    factors = factors_of(geometry.evaluation.factors.mount, window, settings)
    return Evaluation(window, unknowns, trusted, factors)
