"""An estimator of one's own: the linear eight-point algorithm on rays, every match alike."""

import numpy as np

from visual_servo_epipolar.core.geometry.cheirality import oriented_bearings
from visual_servo_epipolar.core.twoview.estimator import Estimate, UNKNOWN_COVARIANCE


def linear_8pt(current, desired, *, noise, prior, rng):
    """Return F with the least p_d^T F p_a over unit rays, (N, 3), and the bearings it gives."""
    rows = (desired[:, :, None] * current[:, None, :]).reshape(-1, 9)
    u, singular, vt = np.linalg.svd(np.linalg.svd(rows)[2][-1].reshape(3, 3))
    fundamental = (u[:, :2] * singular[:2]) @ vt[:2]  # the closest one of rank 2
    vote = oriented_bearings(fundamental, current, desired, noise=float(np.mean(noise)))
    everything = np.ones(len(current), bool)
    return Estimate(vote.bearings, fundamental, everything, vote.confidence, UNKNOWN_COVARIANCE)
