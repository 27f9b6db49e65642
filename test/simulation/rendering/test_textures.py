"""Prefiltered copies of textures: blurred along each axis by what a pixel spans there."""

import numpy as np
import pytest

from visual_servo_epipolar.simulation.rendering.surfaces import _blur, Sheet


def variances(image: np.ndarray) -> tuple[float, float]:
    """Return the variance of the grey of ``image`` along rows and columns [texel^2]."""
    v, u = np.mgrid[: image.shape[0], : image.shape[1]]
    weights = image / image.sum(dtype=float)
    along, across = ((weights * (at - (weights * at).sum()) ** 2).sum() for at in (u, v))
    return along, across


@pytest.mark.parametrize(('sigma_u', 'sigma_v'), [(0.6, 2.0), (2.0, 0.6), (0.0, 1.5), (1.5, 0.0)])
def test_each_axis_is_blur_by_its_own_gaussian(sigma_u: float, sigma_v: float) -> None:
    block = np.zeros((101, 101), np.uint8)
    block[40:61, 40:61] = 250
    before, after = (
        variances(block),
        variances(_blur(Sheet.of(block), sigma_u, sigma_v).whole()),
    )
    # A kernel ends at three deviations, and grey levels are rounded.
    assert after[0] - before[0] == pytest.approx(sigma_u**2, rel=0.05, abs=0.02)
    assert after[1] - before[1] == pytest.approx(sigma_v**2, rel=0.05, abs=0.02)
