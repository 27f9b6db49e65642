"""Which photographs are kept, and when a whole image is matched anew."""

import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.tracking.photographs.photographs import Rematching, superfluous

TEXTURE = np.random.default_rng(1).uniform(0.7, 1.0, (96, 128))
ACROSS, DOWN = np.meshgrid(np.linspace(0.1, 1.0, 128), np.linspace(0.1, 1.0, 96))
LIGHTS = {'all': 0.0 * DOWN + 1.0, 'left': ACROSS[:, ::-1], 'right': ACROSS, 'above': DOWN}


def lit(light: str, exposure: float = 1.0) -> Image:
    return (200.0 * exposure * LIGHTS[light] * TEXTURE).astype(np.uint8)


@pytest.mark.parametrize(
    ('lights', 'most', 'out'),
    [
        (['all'], 1, None),
        (['all', 'left'], 2, None),
        (['all', 'left'], 1, 1),  # the first always stays
        (['all', 'left', 'right', 'left'], 4, 3),  # of a light that is there
        (['all', 'left', 'above', 'right'], 4, None),
    ],
)
def test_of_photographs_those_stay_whose_light_differs(lights, most, out) -> None:
    assert superfluous([lit(light) for light in lights], most) == out


def test_another_exposure_is_no_other_light() -> None:
    assert superfluous([lit('all'), lit('left'), lit('left', 0.3)], 4) == 2


def test_of_too_many_the_older_of_the_two_most_alike_goes() -> None:
    between = (0.5 * lit('left') + 0.5 * lit('above')).astype(np.uint8)
    images = [lit('right'), lit('above'), lit('left'), between]
    assert superfluous(images, 4) is None
    assert superfluous(images, 3) in (1, 2)


def test_an_image_is_matched_anew_at_once_where_nothing_is_known_and_sooner_with_few() -> None:
    rematching = Rematching()
    assert rematching.is_due(0, period=11)
    rematching._elapsed = 0
    due = []
    for left in (30, 30, 30, 10):
        rematching.pass_frame()
        due.append(rematching.is_due(left, period=11))
    assert due == [False, False, False, True]
    rematching.forget()
    assert rematching.is_due(60, period=11)
