"""Lens: an uncalibrated camera matrix, estimated while driving."""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.least_squares import SMALLEST

SHIFT_DEVIATION = 0.02  # of an unmeasured principal point, in focal lengths
SHY = 0.3  # part of the variance before above which what one pair says is taken over slowly
REACH = 2.0  # deviations of what is believed within which the truth is looked for
MOST_RATIO = 8.0  # of focal lengths, as configured over true: no lens is farther from its label
LEAST_VARIANCE = np.diag([0.003, 0.0005]) ** 2  # of ratio and shift: lenses are no pinholes


@dataclass(frozen=True, slots=True)
class Lens:
    """
    What is wrong with a camera matrix: its rays (x, y, z) truly are along (r x + h z, r y, z).

    ``log_ratio`` is log r, of the configured focal length over the true one, ``shift`` h moves
    all image points to the right; the offset of the principal point along v acts as a tilt. The
    ratio is known to ``ratio_deviation``. If it were log_ratio + a, the shift would be shift + a
    ``shift_slope``, and then it is known to ``rest_deviation``. A calibrated camera has deviations
    of 0.
    """

    log_ratio: float = 0.0
    shift: float = 0.0
    ratio_deviation: float = 0.0
    rest_deviation: float = 0.0
    shift_slope: float = 0.0

    @classmethod
    def of(cls, log_ratio: float, shift: float, covariance: FloatArray) -> 'Lens':
        """Return the lens of ratio and shift with their ``covariance``, shape (2, 2)."""
        (ratio, both), (_, own) = covariance.tolist()
        rest = math.sqrt(max(own - both * both / ratio, 0.0))
        return cls(log_ratio, shift, math.sqrt(ratio), rest, both / ratio)

    @property
    def calibrated(self) -> bool:
        """Whether there is nothing to find out."""
        return self.ratio_deviation == 0.0

    @property
    def corrects_nothing(self) -> bool:
        """Whether the rays are right as they are, as far as is known."""
        return self.log_ratio == 0.0 and self.shift == 0.0

    @property
    def root(self) -> FloatArray:
        """Lower triangular root of the covariance of ratio and shift, shape (2, 2)."""
        ratio = self.ratio_deviation
        return np.array([[ratio, 0.0], [self.shift_slope * ratio, self.rest_deviation]])


CALIBRATED = Lens()


def unknown_lens(focal_deviation: float) -> Lens:
    """Return what is known of a lens in the beginning; with a deviation of 0 all."""
    return Lens(0.0, 0.0, focal_deviation, SHIFT_DEVIATION if focal_deviation > 0.0 else 0.0)


def change(after: Lens, before: Lens) -> Lens:
    """Return what turns rays that ``before`` has corrected into those that ``after`` corrects."""
    log_ratio = after.log_ratio - before.log_ratio
    return Lens(log_ratio, after.shift - math.exp(log_ratio) * before.shift)


def learnt(lens: Lens, estimated: Lens) -> Lens:
    """
    Return what is known of ``lens`` after one pair of views.

    ``estimated`` is relative to ``lens``, with the prior counted in. Frames share the noise of
    the photograph: many that say little do not add up to one that says much. So a pair counts in
    full only where it alone tells more than is known, and all together tell no more than the best.
    """
    if lens.calibrated:
        return lens
    # Ratio and shift as two numbers of which (0 +- 1, 0 +- 1) was known before.
    root = lens.root
    inverse = np.linalg.inv(root)
    remaining, axes = np.linalg.eigh(_squared(inverse @ estimated.root))
    values = axes.T @ inverse @ [estimated.log_ratio, estimated.shift]
    rows = [_updated(*row) for row in zip(values.tolist(), remaining.tolist(), strict=True)]
    updates, variances = np.array(rows).T
    log_ratio, shift = (root @ axes @ updates).tolist()
    covariance = _squared(root @ axes * np.sqrt(variances))
    covariance += np.maximum(LEAST_VARIANCE - covariance, 0.0) * np.eye(2)
    most = math.log(MOST_RATIO)
    bounded = min(max(lens.log_ratio + log_ratio, -most), most)
    return Lens.of(bounded, math.exp(log_ratio) * lens.shift + shift, covariance)


def _squared(root: FloatArray) -> FloatArray:
    return np.asarray(root @ root.T)


def _updated(value: float, remaining: float) -> tuple[float, float]:
    """Return the part of ``value`` taken over, and its variance; ``remaining``: of one pair."""
    if not 0.0 < remaining < 1.0:
        return 0.0, 1.0
    alone = remaining / (1.0 - remaining)  # the variance of what this pair alone says
    gain = 1.0 / (1.0 + alone * max(1.0, alone / SHY) ** 2)
    return value * gain * (1.0 + alone), max(1.0 - gain, min(alone, 1.0))


def spurious_parallax(
    rays: FloatArray, heading_error: FloatArray | float, root: FloatArray
) -> FloatArray:
    """
    Return the parallax that a turn shows through a lens that is not known, shape (...) [rad].

    A turn by alpha moves ``rays`` (x, y, z), shape (..., N, 3), by alpha s to the side, with
    s^2 = x^2 + z^2. If the ratio is wrong by e and the shift by h, 2 alpha (e x^2 + h x z) / s of
    it look like no rotation. ``heading_error`` has shape (...) [rad], ``root``, that of the lens,
    shape (..., 2, 2).
    """
    x, z = rays[..., 0], rays[..., 2]
    sideways = x / np.sqrt(np.maximum(x * x + z * z, SMALLEST))
    moves = 2.0 * np.stack([np.std(sideways * x, axis=-1), np.std(sideways * z, axis=-1)], axis=-1)
    deviation = np.sqrt(((moves[..., None, :] @ root)[..., 0, :] ** 2).sum(axis=-1))
    return np.asarray(REACH * np.abs(heading_error) * deviation)


def corrected(rays: FloatArray, lens: Lens) -> tuple[FloatArray, FloatArray]:
    """Return true rays, (..., N, 3), and by how much noise of angles grows, (..., N)."""
    ratio = math.exp(lens.log_ratio)
    vectors = rays * [ratio, ratio, 1.0]
    vectors[..., 0] += lens.shift * rays[..., 2]
    length = np.sqrt((vectors * vectors).sum(axis=-1))
    return np.asarray(vectors / length[..., None]), np.asarray(ratio * length**-1.5)


def for_wrong_rays(fundamental: FloatArray, lens: Lens) -> FloatArray:
    """Return F, shape (3, 3), for rays as they were before ``lens`` corrected them."""
    if lens.corrects_nothing:
        return fundamental
    ratio = math.exp(lens.log_ratio)
    corrects = np.array([[ratio, 0.0, lens.shift], [0.0, ratio, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(corrects.T @ fundamental @ corrects)
