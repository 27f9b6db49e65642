"""Local structure: positions of the features of one photograph, from views around it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.epipolar import MIN_MATCHES
from visual_servo_epipolar.core.mapping.factors import (
    camera_poses,
    factors_of,
    views_of,
)
from visual_servo_epipolar.core.mapping.fitting import (
    Anchors,
    fit_pose,
    MatchedFeatures,
    nearest_view,
    pose_covariance,
    PoseFit,
)
from visual_servo_epipolar.core.mapping.initialization import (
    LEAST_AGREEING,
    refine_narrowing,
    shared_at,
    triangulate,
)
from visual_servo_epipolar.core.mapping.localization import seen_rays
from visual_servo_epipolar.core.mapping.projection import structure_of
from visual_servo_epipolar.core.mapping.refinement import (
    Evaluation,
    Geometry,
    LEAST_INVERSE_DEPTH,
    refine,
)
from visual_servo_epipolar.core.mapping.window import (
    EMPTY,
    FeatureObservations,
    KeyframeWindow,
    MapSettings,
    MOUNT,
    SHARED,
    tangent_basis_of,
    Unknowns,
)
from visual_servo_epipolar.core.twoview.estimator import Attitude

STEPS, ROUNDS = 12, 2
SCALE_DEVIATION = 0.01  # of the logarithm of the true way over that of the odometry
START_NOISE_PX = 0.2  # of a tracked feature, until residuals tell it
ALL_AROUND = 1e-3  # of the logarithm of the focal length: 360 deg are as many pixels as it has
LEAST_VIEWS = 2  # in which a feature is seen, to be kept
LEAST_FEATURES = 12  # of a structure
OBJECT = 0.6  # around a feature, seen from above: what may be one piece of furniture [m]
WITNESSES = 4  # features elsewhere that can contradict it


class SeenView(NamedTuple):
    """What a view shows of a photograph's features: ``ids``, (n,), ``rays``, (n, 3), its place."""

    ids: IntArray
    rays: FloatArray
    pose: FloatArray  # of the camera in axes of the photograph, by the odometry, (3,)


class ViewPose(NamedTuple):
    """
    Pose of a camera, (3,), in axes of a key view, its covariance, (3, 3), how many agree.

    By those alone that stand elsewhere than where most of them stand together its position has the
    deviation ``unaided`` [m], infinite where there are too few.
    """

    pose: FloatArray
    covariance: FloatArray
    inliers: int
    unaided: float


@dataclass(frozen=True, eq=False)
class LocalStructure:
    """
    Features of one photograph: ``pixels``, (N, 2), moved by ``offsets``, (2, N), in deviations.

    ``inverse_depth``, (N,), along their rays [1/m]; ``covariance``, (3, 3, N), of both offsets and
    of it; ``shared``, (5,), attitudes of photograph and mount, and the lens, as ``Unknowns``;
    ``jitter`` is the deviation of the attitude of a view [rad], ``noise`` that of pixels [px].
    """

    pixels: FloatArray
    offsets: FloatArray
    inverse_depth: FloatArray
    covariance: FloatArray
    shared: FloatArray
    jitter: float
    noise: float

    def __len__(self) -> int:
        return len(self.pixels)

    def anchors(self, camera: CameraModel) -> Anchors:
        """Return the features as anchors of other views."""
        rays = camera.rays(self.pixels)
        tangents = tangent_basis_of(rays, 1.0 / (self.noise * camera.resolution(rays)))
        unknowns = Unknowns(np.empty((0, 5)), self.shared, self.offsets, self.inverse_depth)
        structure = structure_of(rays, tangents, unknowns)
        deviation = np.full(2, self.jitter)
        return Anchors(structure, self.covariance, self.shared[MOUNT], deviation)


class Localizer:
    """Places views among the features of one key view."""

    def __init__(self, structure: LocalStructure, camera: CameraModel) -> None:
        self._anchors, self._camera = structure.anchors(camera), camera
        self._noise = structure.noise
        rays, near = self._anchors.structure.rays, self._anchors.structure.inverse_depth
        self._points = (rays / np.maximum(near, LEAST_INVERSE_DEPTH)).T  # right, down, ahead
        self._plan = self._points[:, ::2]

    def rays_seen(self, pose: FloatArray) -> FloatArray:
        """Return unit rays, (N, 3), at which a camera at a ``pose``, (3,), sees the features."""
        view = views_of(pose[None], self._anchors.attitude)[0]
        return seen_rays(self._anchors.structure, view)

    def distances(self, pose: FloatArray) -> FloatArray:
        """Return how far from a camera at a ``pose``, (3,), the features are, (N,) [m]."""
        away = self._points - np.array([-pose[1], 0.0, pose[0]])
        return np.asarray(np.linalg.norm(away, axis=1))

    def locate(self, ids: IntArray, pixels: FloatArray, near: FloatArray) -> ViewPose | None:
        """
        Return the pose by features ``ids``, (n,), at ``pixels``, (n, 2); None if unsure.

        It is ``near`` a pose, (3,), or one of several, (K, 3), with any heading.

        What stands together may have been moved together, and agrees on a place all the same:
        where most features elsewhere contradict it, the pose is not believed.
        """
        if len(ids) < MIN_MATCHES:
            return None
        rays = self._camera.rays(pixels)
        basis = tangent_basis_of(rays, self._noise * self._camera.resolution(rays))
        seen, anchors = MatchedFeatures(ids, rays.T, basis), self._anchors.of(ids)
        starts = views_of(np.atleast_2d(near), anchors.attitude)
        start = starts[0] if near.ndim == 1 else nearest_view(anchors, seen, starts)
        fit = fit_pose(anchors, seen, start)
        agree = int(fit.inliers.sum())
        if agree < max(MIN_MATCHES, LEAST_AGREEING * len(ids)):
            return None
        elsewhere = ~self._largest_object(ids, fit.inliers)
        witnesses, others = int(fit.inliers[elsewhere].sum()), int(elsewhere.sum())
        if others >= WITNESSES and witnesses < LEAST_AGREEING * others:
            return None
        covariance = pose_covariance(anchors, seen, fit)
        turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        covariance = turn @ covariance[:3, :3] @ turn.T
        unaided = math.inf
        if witnesses >= WITNESSES:
            rest = MatchedFeatures(ids[elsewhere], seen.rays[:, elsewhere], basis[..., elsewhere])
            alone = PoseFit(fit.pose, fit.squares[elsewhere], fit.widening)
            position = pose_covariance(anchors.of(np.flatnonzero(elsewhere)), rest, alone)[:2, :2]
            unaided = math.sqrt(float(np.linalg.eigvalsh(position)[-1]))
        pose = camera_poses(fit.pose[None])[0]
        return ViewPose(pose, covariance, agree, unaided)

    def _largest_object(self, ids: IntArray, inliers: BoolArray) -> BoolArray:
        """Return which of features ``ids``, (n,), stand where most ``inliers``, (n,), do."""
        plan = self._plan[ids]
        apart = plan[:, None] - plan[None]
        together = (apart * apart).sum(2) < OBJECT**2
        most = (together & inliers).sum(1) * inliers
        return np.asarray(together[int(most.argmax())])


def learn_structure(
    photograph: FloatArray, views: Sequence[SeenView], camera: CameraModel, mount: Attitude
) -> tuple[IntArray, LocalStructure]:
    """
    Return which features have a place, (N,), and their structure.

    ``photograph``, (M, 2), are the pixels of all features there, to which ids in ``views`` count;
    those are in the order in which they were driven.

    Raises DegenerateGeometryError if the views do not fit one geometry.
    """
    window = _window(photograph, views, camera, START_NOISE_PX)
    poses = np.array([view.pose for view in views])
    attitude = np.array([mount.tilt, mount.roll])
    count = len(window.ids)
    start = Unknowns(
        views_of(poses, attitude), shared_at(attitude), np.zeros((2, count)), np.ones(count)
    )
    start = replace(start, inverse_depth=triangulate(window, start, np.ones(len(views), bool)))
    factors = factors_of(mount, window, MapSettings(scale_deviation=SCALE_DEVIATION))
    if camera.wraps:
        factors = replace(factors, lens_deviation=ALL_AROUND)
    at, damping = refine_narrowing(Evaluation(window, start, np.ones(count, bool), factors))
    noise, geometry = START_NOISE_PX, refine(at, STEPS, damping)
    for _ in range(ROUNDS):
        # On another day at least half: what patches get wrong alike, no residual shows.
        ratio = max(geometry.noise_ratio, START_NOISE_PX / 2 / noise)
        if not math.isfinite(ratio):
            break  # too few residuals to tell it
        noise *= ratio
        window = _window(photograph, views, camera, noise)
        geometry = refine(_renoised(geometry, window, ratio), STEPS, geometry.damping)
    rows = np.flatnonzero(geometry.trusted & (window.seen.sum(0) >= LEAST_VIEWS))
    if len(rows) < LEAST_FEATURES:
        raise DegenerateGeometryError(
            f'{len(rows)} features of a key view have a place, {LEAST_FEATURES} are needed; '
            'drive slower there, or where there is more to see'
        )
    ids, unknowns = window.ids[rows], geometry.unknowns
    return ids, LocalStructure(
        photograph[ids],
        unknowns.offsets[:, rows],
        unknowns.inverse_depth[rows],
        geometry.feature_covariance[..., rows],
        unknowns.shared[:SHARED],
        float(factors.jitter),
        noise,
    )


def _renoised(geometry: Geometry, window: KeyframeWindow, ratio: float) -> Evaluation:
    """Return the evaluation of the same ``window`` with ``ratio`` times the noise."""
    at = geometry.evaluation
    unknowns = replace(at.unknowns, offsets=at.unknowns.offsets / ratio)
    return replace(at, window=window, unknowns=unknowns)


def _window(
    photograph: FloatArray, views: Sequence[SeenView], camera: CameraModel, noise_px: float
) -> KeyframeWindow:
    """Return what ``views`` show, with a noise of pixels."""
    desired = camera.rays(photograph)
    noise = noise_px * camera.resolution(desired)
    window = EMPTY
    for view in views:
        current = noise_px * camera.resolution(view.rays)
        both = np.column_stack([current, noise[view.ids]])
        features = FeatureObservations(view.ids, view.rays, desired[view.ids], both)
        window = window.with_view(features, views_of(view.pose[None], np.zeros(2))[0, :2])
    return window
