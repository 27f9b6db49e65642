"""Steering and its filter: back onto the path, forward and backward, by unequal wheels."""

import math

import numpy as np
import pytest

from visual_servo_epipolar.core.routes.following.steering import brake, LateralFilter, steer
from visual_servo_epipolar.core.routes.settings import FollowSettings

SETTINGS = FollowSettings()
DT = 1.0 / 11.0


def driven(
    speed: float, offset: float, *, wheels: float = 0.0, curvature: float = 0.0
) -> list[float]:
    """Return the true offsets [m] on five metres of a path, seen with a millimetre of noise."""
    rng, it = np.random.default_rng(2), LateralFilter()
    turn, offsets = 0.0, []
    for _ in range(round(5.0 / (abs(speed) * DT))):
        noise = rng.standard_normal(2) * [1e-3, 3e-4]
        it = it.seen(offset + noise[0], turn + noise[1], np.diag([1e-6, 1e-7]))
        twist = steer(it, curvature, speed, SETTINGS)
        rate = twist.angular + twist.linear * (wheels - curvature)
        offset += twist.linear * math.sin(turn + 0.5 * rate * DT) * DT
        turn += rate * DT
        it = it.moved(twist.linear, twist.angular, curvature, DT)
        offsets.append(offset)
    return offsets


@pytest.mark.parametrize('speed', [0.5, 0.2, -0.3])
def test_an_offset_fades_without_passing_the_path_far(speed: float) -> None:
    offsets = driven(speed, 0.1)
    assert abs(np.array(offsets)[-20:]).max() < 5e-3
    assert min(offsets) > -0.01


def test_what_unequal_wheels_add_is_learnt() -> None:
    offsets = driven(0.5, 0.0, wheels=0.03)  # 7.5 mm where it is not
    assert abs(np.mean(offsets[-30:])) < 2e-3


def test_an_arc_is_followed() -> None:
    assert abs(np.array(driven(0.5, 0.0, curvature=0.9))[-30:]).max() < 4e-3


def test_a_step_between_key_views_turns_the_robot_by_little() -> None:
    it = LateralFilter()
    for _ in range(40):
        it = it.seen(0.0, 0.0, np.diag([1e-6, 1e-7])).moved(0.5, 0.0, 0.0, DT)
    before = steer(it, 0.0, 0.5, SETTINGS).angular
    after = steer(it.seen(2e-3, 0.0, np.diag([1e-6, 1e-7])), 0.0, 0.5, SETTINGS).angular
    assert abs(after - before) < 0.05 * SETTINGS.max_turn_rate


def test_it_can_stop_where_the_way_ends() -> None:
    assert brake(0.0, 0.3) <= 0.05
    assert brake(0.5, 0.3) ** 2 / (2.0 * 0.3) <= 0.5


def test_an_epipole_that_lies_behind_does_not_steer() -> None:
    with pytest.raises(ValueError, match='steering epipole must go forward, got reverse'):
        FollowSettings(steering='epipole', reverse=True)
