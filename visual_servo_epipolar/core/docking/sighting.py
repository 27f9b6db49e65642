"""Sightings: views of the photograph along the path, and which of them are worth keeping."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, IntArray
from visual_servo_epipolar.core.docking.path import Place, uncertainty
from visual_servo_epipolar.core.docking.planar import between, upright_axes
from visual_servo_epipolar.core.docking.settings import DockPoseSettings
from visual_servo_epipolar.core.docking.unknowns import Problem
from visual_servo_epipolar.core.geometry.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.perception.observation import Observation, observe
from visual_servo_epipolar.core.tracking.features import Features

MOST_FEATURES = 80  # those seen most often: more cost time, and tell little
SAME_RAY = 1e-6  # [rad]


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """
    One view of the photograph: rays of features by ``ids``, (N,), where the base was, bearings.

    ``rays``, (N, 3), and those of the ``photograph`` have axes forward, left, up; ``resolution``,
    (N, 2), are the angles of a pixel there [rad].
    """

    place: Place
    ids: IntArray
    rays: FloatArray
    photograph: FloatArray
    resolution: FloatArray
    bearings: Bearings | None
    parallax: float

    @classmethod
    def of(
        cls,
        place: Place,
        ids: IntArray,
        observation: Observation,
        bearings: Bearings | None,
        parallax: float,
    ) -> 'Sighting':
        """Return the sighting of an ``observation`` at a ``place``."""
        return cls(
            place,
            ids,
            upright_axes(observation.current),
            upright_axes(observation.desired),
            observation.resolution,
            bearings,
            parallax,
        )

    def is_of_another_photograph(self, other: 'Sighting') -> bool:
        """Return whether features of one name have other rays in the photograph."""
        _, mine, its = np.intersect1d(self.ids, other.ids, return_indices=True)
        if not len(mine):
            return bool(len(self.ids) and len(other.ids))
        apart = np.abs(self.photograph[mine] - other.photograph[its]).max(axis=1)
        return bool(np.median(apart) > SAME_RAY)


def observed(
    features: Features, camera: CameraModel, stamp_ns: int
) -> tuple[IntArray, Observation]:
    """Return the observation of ``features``, and the ids of its rows."""
    observation, ids = observe(features, camera, stamp_ns), features.ids
    if observation.dropped:
        sides = [
            camera.round_trips(pixels, camera.rays(pixels))
            for pixels in (features.current, features.desired)
        ]
        ids = ids[sides[0] & sides[1]]
    return ids, observation


def moved_enough(before: Sighting, now: Sighting, settings: DockPoseSettings) -> bool:
    """Return whether a view shows something new after another."""
    x, y, turn = between(before.place.pose, now.place.pose).tolist()
    return math.hypot(x, y) > settings.key_travel or abs(turn) > settings.key_turn


def thinned(keys: Sequence[Sighting], most: int) -> tuple[Sighting, ...]:
    """Return ``keys`` less those whose neighbours are nearest each other, at most ``most``."""
    keys = list(keys)
    while len(keys) > most:
        gaps = [_gap(keys[k - 1], keys[k + 1]) for k in range(1, len(keys) - 1)]
        keys.pop(1 + int(np.argmin(gaps)))
    return tuple(keys)


def _gap(first: Sighting, last: Sighting) -> float:
    return last.place.way - first.place.way + 0.5 * (last.place.turn - first.place.turn)


def problem_of(views: Sequence[Sighting], noise_px: float, settings: DockPoseSettings) -> Problem:
    """Return what ``views``, in order of time, and the path between them measure."""
    ids, photograph, resolution = _features(views)
    rays = np.zeros((len(ids), len(views), 3))
    rays[..., 0] = 1.0
    seen, noise = np.zeros(rays.shape[:2], bool), np.ones(rays.shape[:2])
    for k, view in enumerate(views):
        _, rows, columns = np.intersect1d(ids, view.ids, return_indices=True)
        rays[rows, k], seen[rows, k] = view.rays[columns], True
        noise[rows, k] = noise_px * view.resolution[columns, 0]
    prior, deviations = settings.shared
    pairs = list(zip(views[:-1], views[1:], strict=True))
    return Problem(
        rays,
        seen,
        noise,
        photograph,
        noise_px * resolution,
        np.array([between(a.place.pose, b.place.pose) for a, b in pairs]).reshape(-1, 3),
        np.array([_root(a.place, b.place, settings) for a, b in pairs]).reshape(-1, 3, 3),
        prior,
        deviations,
        max(math.sqrt(2.0) * settings.floor_jitter, 1e-5),
    )


def _features(views: Sequence[Sighting]) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return ids, rays of the photograph and their resolution, of those seen most often."""
    every = np.concatenate([view.ids for view in views])
    ids, first, counts = np.unique(every, return_index=True, return_counts=True)
    often = np.sort(np.argsort(-counts, kind='stable')[:MOST_FEATURES])
    first = first[often]
    rays = np.concatenate([view.photograph for view in views])[first]
    resolution = np.concatenate([view.resolution[:, 1] for view in views])[first]
    return ids[often], rays, resolution


def _root(before: Place, after: Place, settings: DockPoseSettings) -> FloatArray:
    """Return W, (3, 3), such that W^T W is the information of the motion between two places."""
    covariance = uncertainty(before, after, settings.path_deviation)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
