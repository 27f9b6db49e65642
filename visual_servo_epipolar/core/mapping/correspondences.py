"""
Correspondences: which features of a view are in the map, and what is known of those.

They are the same for all views of the same features, as most are of the one before; what belongs
to them is looked up once.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray
from visual_servo_epipolar.core.mapping.adjustment.refinement import Geometry
from visual_servo_epipolar.core.mapping.adjustment.window import SHARED
from visual_servo_epipolar.core.mapping.fitting import Anchors, anchors_of


class FeatureErrors(NamedTuple):
    """
    Errors of n features: ``own`` roots, (n, 3, 3), and what r errors of keyframes make.

    Those are ``shared``, (n, 6, r), of the unknowns of a feature and of the photograph, and
    ``attitude``, (2, r), of the mount's, in deviations of what the floor does. ``offsets``,
    (2, 1, n), are those that keyframes gave the photograph's rays, in deviations.
    """

    own: FloatArray
    shared: FloatArray
    attitude: FloatArray
    offsets: FloatArray


def errors_of(geometry: Geometry, rows: IntArray) -> FeatureErrors:
    """Return the errors of the features in ``rows``, (n,), of a geometry."""
    covariance_root, count = geometry.covariance_root, len(rows)
    shared = np.empty((count, 6, covariance_root.shape[1]))
    shared[:, :3], shared[:, 3:] = (
        geometry.feature_covariance_root[rows],
        covariance_root[-SHARED:-2],
    )
    jitter = geometry.evaluation.factors.jitter
    return FeatureErrors(
        geometry.system.roots[rows],
        shared,
        covariance_root[-2:] / jitter,
        geometry.unknowns.offsets[:, None, rows],
    )


@dataclass(frozen=True, eq=False)
class Correspondences:
    """
    Correspondences of a view of features ``ids``, (N,), with a ``geometry``.

    ``rows``, (N,), of the features there, -1 for others; ``known``, (N,), says which are trusted
    and have a place. Of those, n, are ``chosen`` rows, (n,), ``anchors`` and ``errors``;
    ``everything`` are the anchors of all features of the geometry. ``slopes`` of D [1/m] are those
    that readings of such views asked for, by the number of features that the photograph shows, and
    whether the lens is wide.
    """

    geometry: Geometry
    ids: IntArray
    rows: IntArray
    known: BoolArray
    chosen: IntArray
    everything: Anchors
    anchors: Anchors
    errors: FeatureErrors
    slopes: dict[tuple[int, bool], float] = field(default_factory=dict)

    def are_of(self, geometry: Geometry, ids: IntArray) -> bool:
        """Return whether they are those of a view of features ``ids``, (N,)."""
        alike = geometry is self.geometry and len(ids) == len(self.ids)
        return alike and bool((ids == self.ids).all())


def correspondences_of(geometry: Geometry, ids: IntArray) -> Correspondences:
    """Return the correspondences of a view of features ``ids``, (N,)."""
    rows = geometry.window.rows_of(ids)
    known = rows >= 0
    known[known] = (geometry.trusted & geometry.window.placed)[rows[known]]
    chosen, everything = rows[known], anchors_of(geometry)
    return Correspondences(
        geometry,
        ids,
        rows,
        known,
        chosen,
        everything,
        everything.of(chosen),
        errors_of(geometry, chosen),
    )
