"""Photographs of many images: less noise than each, and none of a robot that moves."""

import cv2
import numpy as np
import pytest

from visual_servo_epipolar.core.tracking.photographs.averaging import at_rest, averaged, unrest

SIZE = 240, 320
NOISE = 2.0


@pytest.fixture(scope='module')
def scene() -> np.ndarray:
    """Return grey levels of a textured scene."""
    rough = np.random.default_rng(0).uniform(0.0, 255.0, SIZE)
    smooth = cv2.GaussianBlur(rough, (0, 0), 2.0)
    return np.clip(110.0 + 4.0 * (smooth - smooth.mean()), 0.0, 255.0)


def taken(scene: np.ndarray, seed: int, *, noise: float = NOISE) -> np.ndarray:
    rng = np.random.default_rng(seed)
    noisy = scene + rng.normal(0.0, noise, SIZE)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def shifted(scene: np.ndarray, px: float) -> np.ndarray:
    affine = np.array([[1.0, 0.0, px], [0.0, 1.0, 0.0]])
    return cv2.warpAffine(
        scene, affine, SIZE[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )


def enlarged(scene: np.ndarray, px: float) -> np.ndarray:
    """Return the scene from nearer, moved by ``px`` at its left and right border."""
    affine = cv2.getRotationMatrix2D((159.5, 119.5), 0.0, 1.0 + px / 160.0)
    return cv2.warpAffine(
        scene, affine, SIZE[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )


def test_a_mean_has_less_noise_by_the_root_of_its_images(scene) -> None:
    one, mean = taken(scene, 0), averaged([taken(scene, seed) for seed in range(16)])
    assert mean.dtype == np.uint8
    rounding = 1.0 / 12.0
    noise = np.std(one - scene), np.std(mean - scene)
    assert noise[1] == pytest.approx(np.sqrt((noise[0] ** 2 - rounding) / 16 + rounding), rel=0.1)


def test_a_mean_is_rounded_and_one_image_is_itself(scene) -> None:
    one = taken(scene, 0)
    assert averaged([one]) is one
    bright = [np.full((4, 4), level, np.uint8) for level in (255, 255, 254)]
    assert (averaged(bright) == 255).all()


@pytest.mark.parametrize('noise', [0.0, 0.5, 2.0, 8.0])
def test_noise_is_no_motion(scene, noise) -> None:
    images = [taken(scene, seed, noise=noise) for seed in range(12)]
    assert at_rest(images) == (12, '')


@pytest.mark.parametrize('noise', [0.0, 2.0, 8.0])
@pytest.mark.parametrize('move', [shifted, enlarged])
def test_half_a_pixel_is_motion_in_any_noise(scene, move, noise) -> None:
    reason = unrest(taken(scene, 0, noise=noise), taken(move(scene, 0.5), 1, noise=noise))
    assert reason.startswith('the view moves by 0.')


def test_what_blurs_less_than_tracking_errs_is_rest(scene) -> None:
    assert unrest(taken(scene, 0), taken(shifted(scene, 0.03), 1)) == ''


def test_another_light_is_no_motion(scene) -> None:
    assert unrest(taken(scene, 0), taken(0.95 * scene + 5.0, 1)) == ''


def test_who_walks_by_is_seen(scene) -> None:
    walker = scene.copy()
    walker[40:200, 100:140] = 20.0
    assert unrest(taken(scene, 0), taken(walker, 1)).endswith('of the view changes')


@pytest.mark.parametrize('quality', [80, 30])
def test_compression_is_no_motion(scene, quality) -> None:
    def packed(image):
        return cv2.imdecode(cv2.imencode('.jpg', image, [1, quality])[1], 0)

    assert at_rest([packed(taken(scene, seed)) for seed in range(8)]) == (8, '')


def test_images_count_back_to_the_last_motion(scene) -> None:
    still = [taken(scene, seed) for seed in range(5)]
    count, reason = at_rest([*still, taken(shifted(scene, 2.0), 9), *still])
    assert (count, reason[:14]) == (5, 'the view moves')


@pytest.mark.parametrize('shape', [(1, 1), (2, 9), (3, 3), (16, 16)])
def test_images_of_any_size_and_none_in_them_are_compared(shape) -> None:
    blank = np.zeros(shape, np.uint8)
    assert at_rest([blank, blank, np.full(shape, 9, np.uint8)]) == (3, '')
    assert at_rest([blank, np.zeros((20, 20), np.uint8)]) == (1, 'their sizes differ')
