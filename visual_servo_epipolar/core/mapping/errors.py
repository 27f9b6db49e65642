"""Errors of features that a view shows: their own, and those of keyframes, which all share."""

from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, IntArray
from visual_servo_epipolar.core.mapping.adjustment.refinement import Geometry
from visual_servo_epipolar.core.mapping.adjustment.window import SHARED


class Errors(NamedTuple):
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


def errors_of(geometry: Geometry, rows: IntArray) -> Errors:
    """Return the errors of the features in ``rows``, (n,), of a geometry."""
    covariance_root, count = geometry.covariance_root, len(rows)
    shared = np.empty((count, 6, covariance_root.shape[1]))
    shared[:, :3], shared[:, 3:] = (
        geometry.feature_covariance_root[rows],
        covariance_root[-SHARED:-2],
    )
    jitter = geometry.evaluation.factors.jitter
    return Errors(
        geometry.system.roots[rows],
        shared,
        covariance_root[-2:] / jitter,
        geometry.unknowns.offsets[:, None, rows],
    )
