"""Selection: which views become keyframes, and which keyframes and features are let go."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.geometry.epipolar import Bearings, MIN_MATCHES
from visual_servo_epipolar.core.mapping.factors import factors_of
from visual_servo_epipolar.core.mapping.initialization import Start, triangulate
from visual_servo_epipolar.core.mapping.refinement import Evaluation, Geometry
from visual_servo_epipolar.core.mapping.window import (
    differ_in_place,
    FeatureObservations,
    KeyframeWindow,
    MapSettings,
    Unknowns,
    X,
    Y,
)

NEW_SHARE = 0.1  # of the observations of a view that are of features not in the map
FEWEST_NEW = 3
CLOSEST = 1e-3  # distance that keyframes count as apart at least, in depths of the scene
MOST_VIEWS = 4  # to begin with: more cost more time, and are passed soon


class PendingKeyframe(NamedTuple):
    """View that was localized at a ``pose``, (5,); ``new`` of its features are not in the map."""

    observations: FeatureObservations
    pose: FloatArray
    new: int


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
    enough = max(FEWEST_NEW, NEW_SHARE * observations)
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
    places: FloatArray,
    pose: FloatArray,
    settings: MapSettings,
) -> Evaluation:
    """Return the window with one more keyframe at ``pose``, and with what is too much let go."""
    before, trusted = geometry.unknowns, geometry.trusted
    window = geometry.window.with_view(observations, *places)
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


@dataclass(frozen=True, slots=True, eq=False)
class Bootstrap:
    """Views to begin with, what pairs tell of them (``starts``); a geometry ``is_due`` or not."""

    starts: tuple[Start, ...] = ()
    last: FeatureObservations | None = None
    is_due: bool = False

    def is_like_last(self, observations: FeatureObservations) -> bool:
        """Return whether a view is like the last one but for a turn."""
        return self.last is not None and not differ_in_place(self.last, observations)

    def with_view(
        self,
        window: KeyframeWindow,
        observations: FeatureObservations,
        places: FloatArray,
        starts: Sequence[Start],
        *,
        most: int,
    ) -> tuple['Bootstrap', KeyframeWindow]:
        """Return bootstrap and window with a view more, at ``places``, (2, 2), by both motions."""
        before = self.starts
        if len(window) >= MOST_VIEWS:
            window = window.without_view(0)
            before = tuple(each._replace(view=each.view - 1) for each in before if each.view > 0)
        here = tuple(start._replace(view=len(window)) for start in starts)
        window = window.with_view(observations, *places)
        kept = kept_features(window, np.ones(len(window.ids), bool), most)
        bootstrap = Bootstrap((*before, *here), observations, is_due=len(window) > 1)
        return bootstrap, window.of_features(kept)

    @property
    def done(self) -> 'Bootstrap':
        """The same views, that a geometry has been looked for in."""
        return replace(self, is_due=False)


def obstacle(observations: FeatureObservations, bearings: Sequence[Bearings]) -> str:
    """Return in words why nothing can begin with a view; empty if it can."""
    if len(observations) < MIN_MATCHES:
        return f'{len(observations)} features, {MIN_MATCHES} needed to begin'
    return '' if bearings else 'two views show no baseline to begin with'
