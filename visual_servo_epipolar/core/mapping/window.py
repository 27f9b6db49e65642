"""
Features as views show them, keyframes of the map in a window, and the values of all unknowns.

Arrays run over views k, features n and components, features last: (K, ..., N).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray, median
from visual_servo_epipolar.core.geometry.rays import tangents
from visual_servo_epipolar.core.geometry.rotation import fit_rotation, MIN_POINTS

VIEW, SHARED = 5, 5  # unknowns of a view; of all: tilt, roll of the photograph, lens, the mount's
X, Y, HEADING, TILT, ROLL = range(VIEW)
PHOTOGRAPH, LENS, MOUNT = slice(0, 2), 2, slice(3, 5)  # of the shared unknowns
COLLECTED_PARALLAX = 20.0  # in deviations of the noise, that collected views differ by at least


@dataclass(frozen=True, slots=True, eq=False)
class FeatureObservations:
    """
    The features that one view shows, rows are features.

    ``ids``, shape (N,), never change their meaning while there is one photograph; ``current`` and
    ``desired`` are unit rays in axes of the cameras (right, down, forward), shape (N, 3), with the
    distortion of the lens removed; ``noise``, shape (N, 2), is the deviation of the angle of each
    current and desired ray [rad].
    """

    ids: IntArray
    current: FloatArray
    desired: FloatArray
    noise: FloatArray

    def __len__(self) -> int:
        return len(self.ids)

    def take(self, rows: BoolArray) -> 'FeatureObservations':
        """Return the rows chosen by a mask, shape (N,)."""
        if rows.all():
            return self
        return FeatureObservations(
            self.ids[rows], self.current[rows], self.desired[rows], self.noise[rows]
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class MapSettings:
    """
    Bounds of the map.

    ``keyframes`` and ``features`` that it holds at most; ``steps``, iterations a frame when a
    keyframe is new; ``keyframe_spacing``, the least way between keyframes, in depths of the scene;
    ``scale_deviation`` of the logarithm of the true way over the commanded or measured one;
    ``lag``, the way by which a base may be behind those [m].
    """

    keyframes: int = 14
    features: int = 120
    steps: int = 2
    keyframe_spacing: float = 0.03
    scale_deviation: float = 0.05
    lag: float = 0.02


def tangent_basis_of(rays: FloatArray, noise: FloatArray) -> FloatArray:
    """Return two vectors across rays, (N, 3), one over the noise (N,) long: shape (2, 3, N)."""
    tangent_basis = np.empty((2, 3, len(rays)))
    for side, parts in zip(tangent_basis, tangents(*rays.T), strict=True):
        for row, part in zip(side, parts, strict=True):
            np.divide(part, noise, out=row)
    return tangent_basis


def differ_in_place(last: FeatureObservations, now: FeatureObservations) -> bool:
    """Whether two views differ by more than a turn."""
    _, rows, others = np.intersect1d(last.ids, now.ids, assume_unique=True, return_indices=True)
    before, after = last.current[rows], now.current[others]
    if len(before) < MIN_POINTS:
        return True
    return fit_rotation(after, before).parallax > COLLECTED_PARALLAX * median(now.noise[:, 0])


@dataclass(frozen=True, eq=False)
class KeyframeWindow:
    """
    What K keyframes show of N features.

    ``tangent_basis``, (K, 2, 3, N), holds two vectors across each ray, one over its noise long,
    where ``seen``, (K, N); ``photograph``, (N, 3), the photograph's rays and ``photograph_noise``,
    (N,) [rad]. ``driven_places``, (K, 2), are the places of the views by the motion that counts
    [m]; they tell the scale alone.
    """

    ids: IntArray
    photograph: FloatArray
    photograph_noise: FloatArray
    tangent_basis: FloatArray
    rays: FloatArray
    seen: BoolArray
    driven_places: FloatArray

    def __len__(self) -> int:
        return len(self.driven_places)

    @cached_property
    def tangents(self) -> FloatArray:
        """Two directions across the photograph's rays, as long as their noise, (2, 3, N)."""
        return tangent_basis_of(self.photograph, 1.0 / self.photograph_noise)

    @cached_property
    def ways(self) -> FloatArray:
        """The ways between one keyframe and the next [m], shape (K - 1,)."""
        return np.asarray(np.hypot(*np.diff(self.driven_places, axis=0).T))

    def rows_of(self, ids: IntArray) -> IntArray:
        """Return where ``ids`` stand, shape as theirs, -1 for features that are not here."""
        if not len(self.ids):
            return np.full(len(ids), -1)
        order, ascending = self._sorted
        rows = order[np.minimum(np.searchsorted(ascending, ids), len(order) - 1)]
        return np.where(self.ids[rows] == ids, rows, -1)

    @cached_property
    def _sorted(self) -> tuple[IntArray, IntArray]:
        order = np.argsort(self.ids, kind='stable')
        return order, self.ids[order]

    def with_view(
        self, observations: FeatureObservations, driven_place: FloatArray
    ) -> 'KeyframeWindow':
        """Return the window with one more keyframe, and with the features that are new in it."""
        new = self.rows_of(observations.ids) < 0
        noise = np.concatenate([self.photograph_noise, observations.noise[new, 1]])
        wider = replace(
            self,
            ids=np.concatenate([self.ids, observations.ids[new]]),
            photograph=np.concatenate([self.photograph, observations.desired[new]]),
            photograph_noise=noise,
        )
        rows, count = wider.rows_of(observations.ids), len(wider.ids)
        # What a first view has for the noise is a guess: each view after it estimates it anew.
        before = _widened(self.seen, count).sum(0)[rows]
        square = (before * noise[rows] ** 2 + observations.noise[:, 1] ** 2) / (before + 1)
        noise[rows] = np.sqrt(square)
        tangent_basis, rays = np.zeros((1, 2, 3, count)), np.zeros((1, 3, count))
        across = tangent_basis_of(observations.current, observations.noise[:, 0])
        tangent_basis[0][..., rows], rays[0][:, rows] = across, observations.current.T
        seen = np.zeros((1, count), bool)
        seen[0, rows] = True
        return replace(
            wider,
            tangent_basis=np.concatenate([_widened(self.tangent_basis, count), tangent_basis]),
            rays=np.concatenate([_widened(self.rays, count), rays]),
            seen=np.concatenate([_widened(self.seen, count), seen]),
            driven_places=np.concatenate([self.driven_places, driven_place[None]]),
        )

    def without_view(self, k: int) -> 'KeyframeWindow':
        """Return the window without keyframe ``k``."""
        names = 'tangent_basis', 'rays', 'seen', 'driven_places'
        return replace(self, **{it: np.delete(getattr(self, it), k, axis=0) for it in names})

    def of_features(self, kept: BoolArray) -> 'KeyframeWindow':
        """Return the window with the features that are ``kept``, shape (N,), alone."""
        return replace(
            self,
            ids=self.ids[kept],
            photograph=self.photograph[kept],
            photograph_noise=self.photograph_noise[kept],
            tangent_basis=self.tangent_basis[..., kept],
            rays=self.rays[..., kept],
            seen=self.seen[:, kept],
        )


def _widened(array: NDArray[Any], count: int) -> NDArray[Any]:
    """Return an array of features, (..., N), for so many of them, with zeros for the last."""
    missing = np.zeros((*array.shape[:-1], count - array.shape[-1]), array.dtype)
    return np.concatenate([array, missing], axis=-1)


EMPTY = KeyframeWindow(
    np.empty(0, np.int64),
    np.empty((0, 3)),
    np.empty(0),
    np.empty((0, 2, 3, 0)),
    np.empty((0, 3, 0)),
    np.empty((0, 0), bool),
    np.empty((0, 2)),
)


@dataclass(frozen=True, eq=False)
class Unknowns:
    """
    Values of all unknowns.

    ``views``, (K, 5): x (right) and y (ahead) of the camera in the plane of the photograph's [m],
    heading error (left positive), tilt and roll [rad]; ``shared``, (5,): tilt and roll of the
    photograph, the logarithm of the focal length over the calibrated one, tilt and roll of the
    camera where the floor is even; ``offsets``, (2, N), of the
    photograph's rays in deviations; ``inverse_depth``, (N,), inverse depths along them [1/m].
    """

    views: FloatArray
    shared: FloatArray
    offsets: FloatArray
    inverse_depth: FloatArray

    def moved(self, step: FloatArray, features: FloatArray) -> 'Unknowns':
        """Return the unknowns after a ``step``, (D,), and that of ``features``, (3, N)."""
        size = self.views.size
        return Unknowns(
            self.views + step[:size].reshape(-1, VIEW),
            self.shared + step[size:],
            self.offsets + features[:2],
            self.inverse_depth + features[2],
        )

    def of_features(self, kept: BoolArray) -> 'Unknowns':
        """Return the unknowns with those of the features that are ``kept``, shape (N,), alone."""
        return replace(self, offsets=self.offsets[:, kept], inverse_depth=self.inverse_depth[kept])

    def scaled(self, ratio: float) -> 'Unknowns':
        """Return the same geometry, ``ratio`` times as large: all behind if negative."""
        views = self.views.copy()
        views[:, :HEADING] *= ratio
        return replace(self, views=views, inverse_depth=self.inverse_depth / ratio)
