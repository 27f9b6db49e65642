"""Twin of a geometry: another place and turn before another wall, and the same image."""

import math

import numpy as np
import pytest

from visual_servo_epipolar.core.mapping.planar_ambiguity import exchanged_bearings


def homography(place: np.ndarray, heading: float, wall: np.ndarray) -> np.ndarray:
    """Return what a view turned left by ``heading`` at a place makes of points of a wall."""
    cosine, sine = math.cos(heading), math.sin(heading)
    turned = np.array([[cosine, sine], [-sine, cosine]])  # to axes of the view, right and ahead
    return np.asarray(turned @ (np.eye(2) - np.outer(place, wall)))


@pytest.mark.parametrize('seed', range(20))
def test_both_geometries_show_one_image(seed: int) -> None:
    rng = np.random.default_rng(seed)
    place, heading = rng.uniform([-1.0, -2.0], [1.0, -0.2]), rng.uniform(-0.5, 0.5)
    wall = rng.uniform([-0.1, 0.1], [0.1, 0.4])
    told = exchanged_bearings(np.array([*place, heading, 0.0, 0.0]), wall)
    assert told is not None
    direction = np.array([math.cos(told.psi), math.sin(told.psi)])
    back = homography(np.zeros(2), told.heading_error, np.zeros(2)).T
    # What is left of the true view's homography, once turned back, is I - p' m'^T.
    left = np.eye(2) - back @ homography(place, heading, wall)
    size = np.linalg.norm(left)
    assert np.linalg.norm(left - np.outer(direction, direction @ left)) < 1e-9 * size
    assert (direction @ wall) * (place @ wall) > 0.0  # on the same side of it
    again = exchanged_bearings(
        np.array([*direction, told.heading_error, 0.0, 0.0]), direction @ left
    )
    assert again is not None
    assert math.remainder(again.psi - math.atan2(place[1], place[0]), math.tau) == pytest.approx(
        0.0
    )
    assert again.heading_error == pytest.approx(heading)


def test_without_a_place_or_a_wall_there_is_none() -> None:
    wall = np.array([0.0, 0.2])
    assert exchanged_bearings(np.zeros(5), wall) is None
    assert exchanged_bearings(np.array([0.1, -1.0, 0.0, 0.0, 0.0]), 0.0 * wall) is None
