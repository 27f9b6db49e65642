"""Every phase can be told from the others, and the robot has its size and heading."""

from itertools import combinations
import math

import numpy as np
import pytest
from servo_states import PHASES

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.geometry.motion import HALF_PI, Pose
from visual_servo_epipolar.core.laws.registry import GREY, phase_colour
from visual_servo_epipolar.report.style import (
    rgb,
    robot_body,
    robot_nose,
    text_colour_on,
    view_wedge,
)

# What those who lack one kind of cone see of linear red, green, blue (Vienot, Brettel and Mollon
# 1999).
NORMAL = np.eye(3)
DEUTERANOPIA = np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1]])
PROTANOPIA = np.array([[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1]])


def perceived(colour: str, eye: FloatArray) -> FloatArray:
    linear = (np.array(rgb(colour)) / 255.0) ** 2.2
    return np.asarray(255.0 * np.clip(eye @ linear, 0.0, 1.0) ** (1.0 / 2.2), dtype=np.float64)


@pytest.mark.parametrize('eye', [NORMAL, DEUTERANOPIA, PROTANOPIA])
def test_phases_differ_even_to_the_colour_blind(eye: FloatArray) -> None:
    for one, other in combinations(PHASES, 2):
        colours = [perceived(phase_colour(phase.value), eye) for phase in (one, other)]
        # Thirty of 441: the closest pair of the palette of Okabe and Ito is at 37.
        assert np.linalg.norm(colours[0] - colours[1]) > 30.0, (one, other)


def test_word_that_is_no_phase_has_a_colour() -> None:
    assert phase_colour('tracking') == GREY
    assert GREY not in [phase_colour(phase.value) for phase in PHASES]


def test_text_is_black_on_bright_and_white_on_dark() -> None:
    assert (text_colour_on('#FFFFFF'), text_colour_on('#0072B2')) == ('#000000', '#FFFFFF')


def test_robot_points_along_its_heading() -> None:
    body, nose = (shape(Pose(1.0, 2.0, HALF_PI)) for shape in (robot_body, robot_nose))
    np.testing.assert_allclose(np.ptp(body, axis=0), (0.40, 0.45))
    np.testing.assert_allclose(nose[0], (1.0, 2.20))


def test_wedge_opens_from_the_camera_by_its_angle() -> None:
    wedge = view_wedge(Pose(1.0, 0.0, 0.0), angle=1.2, reach=2.0)
    np.testing.assert_allclose(wedge[0], (1.0, 0.0))
    np.testing.assert_allclose(wedge[-1], (1.0 + 2.0 * math.cos(0.6), 2.0 * math.sin(0.6)))


def test_who_sees_all_around_has_a_circle_without_a_corner() -> None:
    circle = view_wedge(Pose(2.0, -1.0, 0.3), angle=math.tau, reach=0.5)
    assert np.hypot(*(circle - (2.0, -1.0)).T) == pytest.approx(0.5)
