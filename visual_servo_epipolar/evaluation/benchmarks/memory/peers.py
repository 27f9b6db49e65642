"""Peers: what others make of the same last view: two views alone, OpenCV on the same structure."""

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
    sightings = drive.sightings(k)
    try:
        estimate = soft_planar(
            sightings.current,
            sightings.desired,
            noise=sightings.noise,
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
    sightings, window = drive.sightings(k), geometry.window
    rows = window.rows_of(sightings.ids)
    known = (rows >= 0) & geometry.trusted[rows]
    near = geometry.unknowns.inverse_depth[rows[known]]
    ahead = near > 0.0
    structure = geometry.evaluation.structure.rays[:, rows[known]][:, ahead].T
    points = structure / near[ahead, None]
    pixels = drive.pixels[k + 1, sightings.ids[known]][ahead]
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
