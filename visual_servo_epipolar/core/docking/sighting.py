"""Sightings: views of the photograph along the path, and which of them are worth keeping."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, IntArray
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.docking.path import Place, uncertainty
from visual_servo_epipolar.core.docking.path_factors import PathFactors
from visual_servo_epipolar.core.docking.planar import between
from visual_servo_epipolar.core.docking.settings import DockPoseSettings
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.mapping.adjustment.window import EMPTY, Window
from visual_servo_epipolar.core.mapping.feature_observations import FeatureObservations
from visual_servo_epipolar.core.perception.observation import Observation, observe
from visual_servo_epipolar.core.tracking.features import Features

MOST_FEATURES = 80  # those seen most often: more cost time, and tell little
SAME_RAY = 1e-6  # [rad]


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """
    One view of the photograph: rays of features by ``ids``, (N,), where the base was, bearings.

    ``rays``, (N, 3), and those of the ``photograph`` have axes right, down, forward;
    ``resolution``, (N, 2), are the angles of a pixel there [rad].
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
            observation.current,
            observation.desired,
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


def window_of(views: Sequence[Sighting], noise_px: float) -> Window:
    """Return what ``views``, in order of time, show of the features that are seen most often."""
    window = EMPTY
    for view in views:
        noise = noise_px * view.resolution
        seen = FeatureObservations.owning(view.ids, view.rays, view.photograph, noise)
        window = window.with_view(seen, view.place.pose[:2])
    often = np.argsort(-window.seen.sum(0), kind='stable')[:MOST_FEATURES]
    return window.of_features(np.isin(np.arange(len(window.ids)), often))


def factors_along(views: Sequence[Sighting], settings: DockPoseSettings) -> PathFactors:
    """Return what the path between ``views``, and the settings, tell beside the images."""
    pairs = list(zip(views[:-1], views[1:], strict=True))
    motions = [between(a.place.pose, b.place.pose) for a, b in pairs]
    weights = [_root(a.place, b.place, settings) for a, b in pairs]
    return PathFactors(
        settings.mount,
        len(views),
        way=0.0,
        scale_deviation=math.inf,
        motions=np.array(motions).reshape(-1, 3),
        weights=np.array(weights).reshape(-1, 3, 3),
        prior=np.append(settings.camera_place, 0.0),
        deviations=settings.path_deviations,
    )


def _root(before: Place, after: Place, settings: DockPoseSettings) -> FloatArray:
    """Return W, (3, 3), such that W^T W is the information of the motion between two places."""
    covariance = uncertainty(before, after, settings.path_deviation)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
