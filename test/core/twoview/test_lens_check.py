"""A camera_info that two views contradict is said; a right one never is."""

import cv2
import numpy as np
import pytest
from strategies import blurred, matches, seen_from, through_lens

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.twoview.lens_check import contradicted_by_pair
from visual_servo_epipolar.core.twoview.observation import Observation

FOCAL, NOISE_PX, COUNT = 769.0, 0.2, 120
STARTS = [(1.0, -3.5, 8.0), (-1.2, -2.5, -12.0)]


def said(current: np.ndarray, desired: np.ndarray, scale: float) -> str:
    """Return what is said of noisy rays through a lens of ``scale`` times its focal length."""
    rng = np.random.default_rng(0)
    seen = (
        through_lens(blurred(rays, NOISE_PX / FOCAL, rng), 1.0 / scale)
        for rays in (current, desired)
    )
    return contradicted_by_pair(Observation(0, *seen, scale * FOCAL), ServoSettings())[0]


@pytest.mark.parametrize('start', STARTS)
@pytest.mark.parametrize('scale', [0.5, 1.0, 2.0])
def test_a_wrong_focal_length_of_a_pair_is_said_with_the_right_one(start, scale) -> None:
    doubt = said(*matches(Pose.from_start(*start), count=COUNT), scale)
    if scale == 1.0:
        assert doubt == ''
        return
    assert doubt.startswith(
        f'the matches contradict the camera: a focal length of {scale * 769:.0f}'
    )
    assert float(doubt.split('they say ')[1].split()[0]) == pytest.approx(FOCAL, rel=0.1)


@pytest.mark.parametrize('scale', [0.5, 1.0, 2.0])
@pytest.mark.parametrize('start', [(0.9, -1.5, -6.0), (-1.1, -1.2, 9.0)])
def test_one_wall_tells_nothing(start: tuple[float, float, float], scale: float) -> None:
    tilt, _ = cv2.Rodrigues(np.array([0.1, 0.0, 0.0]))
    wall = np.random.default_rng(1).uniform([-2.0, -0.8, 3.0], [2.0, 0.8, 3.0], (300, 3))
    current = seen_from(Pose.from_start(*start), wall)
    shown = np.abs(current[:, 0]) < 0.83 * current[:, 2]
    views = (normalised(points[shown]) @ tilt for points in (current, wall))
    assert said(*views, scale) == ''


@pytest.mark.parametrize(
    ('wide', 'focal_deviation', 'count'),
    [(True, 0.0, COUNT), (False, 0.3, COUNT), *((False, 0.0, few) for few in (0, 1, 5, 11))],
)
def test_what_is_wide_not_calibrated_or_few_tells_nothing(wide, focal_deviation, count) -> None:
    current, desired = (rays[:count] for rays in matches(Pose.from_start(*STARTS[0]), count=COUNT))
    view = Observation(0, current, desired, FOCAL, wide=wide)
    assert contradicted_by_pair(view, ServoSettings(focal_deviation=focal_deviation)) == ('', None)
