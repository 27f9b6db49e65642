"""
Significance of an epipolar geometry: whether as many matches agree on it by chance.

A contrario (Moisan and Stival 2004): of all geometries that seven of n random matches define, how
many are expected to collect k inliers? Random matches are not modelled but drawn: the same
features, each paired with another one's partner, show how often chance fits this very geometry.
"""

import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, IntArray
from visual_servo_epipolar.core.geometry.epipolar import sampson_distance

SAMPLE, MODELS = 7, 3  # matches that define a geometry, and how many they define at most
CROSSED = 4000  # pairs that are crossed, about
TURN = math.radians(30.0)  # features of one view turn alike, within this of the median
ZOOM = 0.75  # and grow alike, octaves
PARTS = 4, 2  # of the image, across and down, in each of which residuals may err together


def together(pulls: FloatArray, inverse: FloatArray, rays: FloatArray) -> float:
    """
    Return how much larger a variance is than if each residual had its own, at least 1.

    What moves, a lens, a shutter or a look-alike moves all matches of a part of the image: their
    ``pulls``, (K, N), whose covariance is ``inverse``, (K, K), then add up within parts, more than
    by chance. ``rays``, (N, 3), are those of the matches.
    """
    rank = np.arctan2(rays[:, 0], rays[:, 2]).argsort().argsort()
    part = rank * PARTS[0] // len(rays) * PARTS[1] + (rays[:, 1] > np.median(rays[:, 1]))
    sums = pulls @ (part[:, None] == np.arange(PARTS[0] * PARTS[1]))
    each, whole = (float((inverse * (of @ of.T)).sum()) for of in (pulls, sums))
    return max(whole / each, 1.0) if each else 1.0


def log_false_alarms(
    fundamental: FloatArray, current: FloatArray, desired: FloatArray, inliers: BoolArray
) -> float:
    """
    Return log10 of how many geometries that fit as well are expected among random matches.

    Parameters
    ----------
    fundamental : array, shape (3, 3)
        F such that p_desired^T F p_current = 0, in pixels; or E of unit rays.
    current, desired : arrays, shape (N, 4) or (N, 5)
        Features of the matches: pixel or ray, angle [rad], and logarithm of the size to base 2.
    inliers : array, shape (N,)
        Which of the matches the geometry rests on.

    Returns
    -------
    float
        Far below zero: no chance. Infinite of fewer than eight inliers.

    """
    change = current[:, -2:] - desired[:, -2:]  # turn [rad] and growth [octaves]
    typical = _typical(change[inliers])
    alike = _alike(change, typical)
    error = np.abs(sampson_distance(fundamental, current[:, :-2], desired[:, :-2]))
    errors = np.sort(error[inliers & alike])
    if len(errors) <= SAMPLE:
        return math.inf
    crossed = _crossed(len(current))
    paired = current[crossed[:, 0]], desired[crossed[:, 1]]
    like = _alike(paired[0][:, -2:] - paired[1][:, -2:], typical)
    chance_alike = (1.0 + float(like.sum())) / (1.0 + len(like))
    off = np.sort(np.abs(sampson_distance(fundamental, *(each[:, :-2] for each in paired))))
    counts = np.arange(SAMPLE + 1, len(errors) + 1)
    chance = (1.0 + np.searchsorted(off, errors[SAMPLE:], side='right')) / (1.0 + len(off))
    values = (
        _log_tests(len(current), counts)
        + (counts - SAMPLE) * np.log10(chance)
        + (counts - 1) * math.log10(chance_alike)  # the median is one of them
    )
    return float(values.min())


def _log_tests(total: int, counts: IntArray) -> FloatArray:
    """Return log10 of the number of geometries and sets of inliers that might have been found."""
    geometries = math.log(MODELS * (total - SAMPLE))
    sets = [_log_comb(total, k) + _log_comb(k, SAMPLE) for k in counts.tolist()]
    return (geometries + np.array(sets)) / math.log(10.0)


def _log_comb(n: int, k: int) -> float:
    """Return the logarithm of n over k."""
    return math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)


def _crossed(count: int) -> IntArray:
    """Return index pairs of features that are no match, shape (M, 2): each with later ones."""
    shifts = np.arange(1, min(count - 1, max(CROSSED // count, 1)) + 1)
    desired = np.tile(np.arange(count), len(shifts))
    return np.column_stack([(desired + np.repeat(shifts, count)) % count, desired])


def _typical(change: FloatArray) -> FloatArray:
    """Return the mean turn and the median growth, shape (2,)."""
    turn = math.atan2(float(np.sin(change[:, 0]).sum()), float(np.cos(change[:, 0]).sum()))
    return np.array([turn, float(np.median(change[:, 1]))])


def _alike(change: FloatArray, typical: FloatArray) -> BoolArray:
    """Return which features turn and grow as is ``typical``, shape (N,)."""
    off = change - typical
    turn = np.abs((off[:, 0] + math.pi) % (2.0 * math.pi) - math.pi)
    return np.asarray((turn <= TURN) & (np.abs(off[:, 1]) <= ZOOM))
