"""
Peers: what others make of the same last view.

Two views alone, OpenCV on the same structure, and the 1-D trifocal tensor, the third view of the
literature, from photograph and two views: Lopez-Nicolas, Guerrero, Sagues, "Visual control through
the trifocal tensor for nonholonomic robots" (Robotics and Autonomous Systems 2010), and Becerra,
Lopez-Nicolas, Sagues (2010): bearings in the plane, eight numbers that are linear in what three
views show of seven features or more.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import Prior
from visual_servo_epipolar.core.estimators.soft_planar import soft_planar
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.mapping.adjustment.refinement import Geometry
from visual_servo_epipolar.evaluation.benchmarks.memory.study import StudyTrial


class PeerPose(NamedTuple):
    """Lateral and longitudinal offset [m] and heading error [rad], nan where not known."""

    lateral: float
    longitudinal: float
    heading: float


NOTHING = PeerPose(math.nan, math.nan, math.nan)


def by_two_views(drive: StudyTrial, k: int) -> PeerPose:
    """
    Return what photograph and view ``k`` alone say, told where it is but for their noise.

    Two views know directions alone: the true distance is given, and the true bearings as prior.
    """
    x, y, heading = drive.views[k, :3].tolist()
    true = Bearings.from_pose(Pose(x, y, heading + 0.5 * math.pi))
    observations = drive.observations(k)
    try:
        estimate = soft_planar(
            observations.current,
            observations.desired,
            noise=observations.noise,
            prior=Prior(drive.mount, true, deviation=math.pi, mount=drive.mount),
            rng=np.random.default_rng(0),
        )
    except DegenerateGeometryError:
        return NOTHING
    distance, bearings = math.hypot(x, y), estimate.bearings
    lateral = distance * math.cos(bearings.psi)
    return PeerPose(lateral, distance * math.sin(bearings.psi), bearings.heading_error)


def by_opencv(drive: StudyTrial, k: int, geometry: Geometry) -> PeerPose:
    """Return the pose by solvePnPRansac and its refinement, on the structure of ``geometry``."""
    observations, window = drive.observations(k), geometry.window
    rows = window.rows_of(observations.ids)
    known = (rows >= 0) & geometry.trusted[rows]
    near = geometry.unknowns.inverse_depth[rows[known]]
    ahead = near > 0.0
    structure = geometry.evaluation.structure.rays[:, rows[known]][:, ahead].T
    points = structure / near[ahead, None]
    pixels = drive.pixels[k + 1, observations.ids[known]][ahead]
    camera = drive.settings.camera
    matrix = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0, 0, 1.0]])
    found, turn, shift, inliers = cv2.solvePnPRansac(
        points, pixels, matrix, None, reprojectionError=4.0 * drive.settings.noise
    )
    if not found:
        return NOTHING
    rows = inliers[:, 0]
    turn, shift = cv2.solvePnPRefineLM(points[rows], pixels[rows], matrix, None, turn, shift)
    rotation, _ = cv2.Rodrigues(turn)
    return _pose_of(np.asarray(rotation, float), np.asarray(shift, float).ravel())


def _pose_of(rotation: FloatArray, shift: FloatArray) -> PeerPose:
    """Return the pose of a camera that sees an upright point X at ``rotation`` X + ``shift``."""
    place, ahead = -rotation.T @ shift, rotation[2]
    return PeerPose(float(place[0]), float(place[2]), math.atan2(-ahead[0], ahead[2]))


DRAWS, LEAST = 200, 7
INLIER = 4.0  # deviations of a bearing
ROUNDS, STEPS, DIFFERENCE = 5, 30, 1e-6


def by_trifocal(drive: StudyTrial, k: int, other: int = 0) -> FloatArray:
    """
    Return lateral and longitudinal offset [m] and heading error [rad] of view ``k``, (3,).

    ``other`` is the second view; it is told how far off that is, which no view can say, and begins
    at the true places: two sets of them have the same tensor. All nan where too little is seen in
    all three.
    """
    lines, noise = _lines(drive, other, k)
    if lines.shape[1] < LEAST:
        return np.full(3, np.nan)
    tensor = estimate_tensor(lines, INLIER * noise, np.random.default_rng(k))
    x, y, turn = drive.views[other, :3].tolist()
    distance = math.hypot(x, y)
    third = drive.views[k, :3] / [distance, distance, 1.0]
    found = _fit_poses(tensor, np.array([math.atan2(y, x), turn, *third]))
    return np.array([distance * found[2], distance * found[3], found[4]])


def _lines(drive: StudyTrial, other: int, k: int) -> tuple[FloatArray, float]:
    """Return what lies across bearings, (3, N, 2), and their noise [rad]."""
    second, third = drive.observations(other), drive.observations(k)
    _, rows, more = np.intersect1d(second.ids, third.ids, assume_unique=True, return_indices=True)
    rays = third.desired[more], second.current[rows], third.current[more]
    bearings = np.array([np.arctan2(ray[:, 0], ray[:, 2]) for ray in rays])
    noise = float(np.median(third.noise)) if len(rows) else math.nan
    return np.stack([np.cos(bearings), -np.sin(bearings)], axis=-1), noise


def estimate_tensor(lines: FloatArray, bound: float, rng: np.random.Generator) -> FloatArray:
    """Return the tensor, (2, 2, 2), that most features agree with, to ``bound`` [rad]."""
    count = lines.shape[1]
    best = np.ones(count, bool)
    for _ in range(DRAWS):
        drawn = rng.choice(count, LEAST, replace=False)
        inliers = np.abs(_residuals(_linear(lines[:, drawn]), lines)) <= bound
        if not best.any() or best.all() or inliers.sum() > best.sum():
            best = inliers
    if best.sum() < LEAST:
        best = np.ones(count, bool)
    tensor = _linear(lines[:, best])
    for _ in range(ROUNDS):
        kept = np.abs(_residuals(tensor, lines)) <= bound
        if kept.sum() < LEAST:
            break
        tensor = _linear(lines[:, kept], 1.0 / _lengths(tensor, lines[:, kept]))
    return tensor


def _linear(lines: FloatArray, weight: FloatArray | float = 1.0) -> FloatArray:
    rows = np.einsum('ni,nj,nk->nijk', *lines).reshape(-1, 8)
    _, _, axes = np.linalg.svd(rows * np.reshape(weight, (-1, 1)))
    return np.asarray(axes[-1].reshape(2, 2, 2))


def _transfer(tensor: FloatArray, lines: FloatArray) -> FloatArray:
    """Return what lies along the third bearing, (N, 2), by the other two."""
    return np.asarray(np.einsum('ijk,ni,nj->nk', tensor, lines[0], lines[1]))


def _lengths(tensor: FloatArray, lines: FloatArray) -> FloatArray:
    return np.asarray(np.maximum(np.linalg.norm(_transfer(tensor, lines), axis=1), 1e-12))


def _residuals(tensor: FloatArray, lines: FloatArray) -> FloatArray:
    """Return by what angles third bearings are off [rad], (N,)."""
    along = _transfer(tensor, lines)
    return np.asarray((along * lines[2]).sum(1) / _lengths(tensor, lines))


def tensor_of(poses: FloatArray) -> FloatArray:
    """
    Return the unit tensor of psi and heading of the second view, x, y and heading of the third.

    The second is a metre off. Three lines meet where the determinant of their rows is zero.
    """
    psi, turn, x, y, heading = poses.tolist()
    cameras = (
        np.eye(2, 3),
        _camera(math.cos(psi), math.sin(psi), turn),
        _camera(x, y, heading),
    )
    tensor = np.empty((2, 2, 2))
    for i, j, k in np.ndindex(2, 2, 2):
        tensor[i, j, k] = np.linalg.det(np.array([cameras[0][i], cameras[1][j], cameras[2][k]]))
    return np.asarray(tensor / np.linalg.norm(tensor))


def _camera(x: float, y: float, heading: float) -> FloatArray:
    """Return what turns a place, (right, ahead, 1), into that in axes of a camera, (2, 3)."""
    c, s = math.cos(heading), math.sin(heading)
    back = np.array([[c, s], [-s, c]])
    return np.asarray(np.hstack([back, -back @ np.array([[x], [y]])]))


def _fit_poses(tensor: FloatArray, start: FloatArray) -> FloatArray:
    """Return the poses whose tensor is nearest to one that was measured."""
    poses = start
    sign = 1.0 if (tensor_of(poses) * tensor).sum() >= 0.0 else -1.0
    for _ in range(STEPS):
        here = tensor_of(poses)
        slopes = [
            (tensor_of(poses + DIFFERENCE * axis) - here).ravel() / DIFFERENCE
            for axis in np.eye(5)
        ]
        residual = (here - sign * tensor).ravel()
        step, *_ = np.linalg.lstsq(np.array(slopes).T, residual, rcond=None)
        poses = poses - step
        if np.abs(step).max() < 1e-10:
            break
    return np.asarray(poses)
