"""Key views: views of the photograph along the path that are worth keeping."""

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, IntArray
from visual_servo_epipolar.core.docking.settings import DockPoseSettings
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.planar_poses import relative_pose
from visual_servo_epipolar.core.mapping.adjustment.factors import PathFactors
from visual_servo_epipolar.core.mapping.adjustment.window import EMPTY, KeyframeWindow
from visual_servo_epipolar.core.mapping.feature_observations import FeatureObservations
from visual_servo_epipolar.core.odometry.path import PathPlace, uncertainty
from visual_servo_epipolar.core.perception.observation import Observation

MOST_FEATURES = 80  # those seen most often: more cost time, and tell little
SAME_RAY = 1e-6  # [rad]


@dataclass(frozen=True, slots=True, eq=False)
class KeyView:
    """View along the path: where the base was, what it saw, and the bearings of that pair."""

    place: PathPlace
    observation: Observation
    bearings: Bearings | None
    parallax: float

    @property
    def ids(self) -> IntArray:
        """The features by name, (N,)."""
        ids = self.observation.ids
        return np.arange(len(self.observation)) if ids is None else ids

    def is_of_another_photograph(self, other: 'KeyView') -> bool:
        """Return whether features of one name have other rays in the photograph."""
        _, mine, its = np.intersect1d(self.ids, other.ids, return_indices=True)
        if not len(mine):
            return bool(len(self.ids) and len(other.ids))
        apart = np.abs(self.observation.desired[mine] - other.observation.desired[its])
        return bool(np.median(apart.max(axis=1)) > SAME_RAY)


def moved_enough(before: KeyView, now: KeyView, settings: DockPoseSettings) -> bool:
    """Return whether a view shows something new after another."""
    x, y, turn = relative_pose(before.place.pose, now.place.pose).tolist()
    return math.hypot(x, y) > settings.key_travel or abs(turn) > settings.key_turn


def thin_out(keys: Sequence[KeyView], most: int) -> tuple[KeyView, ...]:
    """Return ``keys`` less those whose neighbours are nearest each other, at most ``most``."""
    keys = list(keys)
    while len(keys) > most:
        gaps = [_gap(keys[k - 1], keys[k + 1]) for k in range(1, len(keys) - 1)]
        keys.pop(1 + int(np.argmin(gaps)))
    return tuple(keys)


def _gap(first: KeyView, last: KeyView) -> float:
    return last.place.way - first.place.way + 0.5 * (last.place.turn - first.place.turn)


def window_of(views: Sequence[KeyView], noise_px: float) -> KeyframeWindow:
    """Return what ``views``, in order of time, show of the features that are seen most often."""
    window = EMPTY
    for view in views:
        seen, noise = view.observation, noise_px * view.observation.resolution
        features = FeatureObservations.owning(view.ids, seen.current, seen.desired, noise)
        window = window.with_view(features, view.place.pose[:2])
    often = np.argsort(-window.seen.sum(0), kind='stable')[:MOST_FEATURES]
    return window.of_features(np.isin(np.arange(len(window.ids)), often))


def factors_along(views: Sequence[KeyView], settings: DockPoseSettings) -> PathFactors:
    """Return what the path between ``views``, and the settings, tell beside the images."""
    pairs = list(zip(views[:-1], views[1:], strict=True))
    motions = [relative_pose(a.place.pose, b.place.pose) for a, b in pairs]
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


def _root(before: PathPlace, after: PathPlace, settings: DockPoseSettings) -> FloatArray:
    """Return W, (3, 3), such that W^T W is the information of the motion between two places."""
    covariance = uncertainty(before, after, settings.path_deviation)
    return np.asarray(np.linalg.inv(np.linalg.cholesky(covariance)))
