"""White balance: what colours of the light do to the grey of a camera that has colours."""

import numpy as np
import pytest

from visual_servo_epipolar.simulation.light.exposure import GAIN_STEP, WhiteBalance
from visual_servo_epipolar.simulation.light.lights import LIGHTS

WARM, WHITE = LIGHTS['lamp_right'].colour, LIGHTS['ceiling'].colour


def test_white_light_needs_no_gains() -> None:
    balance = WhiteBalance()
    assert balance.take(WHITE) == pytest.approx(1.0)
    np.testing.assert_allclose(balance.colours, 1.0)


def test_a_warm_lamp_is_red_by_the_gains_of_white_light() -> None:
    balance = WhiteBalance()
    balance.take(WARM)
    blue, green, red = balance.colours
    assert blue < green < red


def test_gains_that_settled_make_a_warm_lamp_white() -> None:
    balance = WhiteBalance()
    balance.settle(WARM)
    assert balance.take(WARM) == pytest.approx(WARM[1])
    np.testing.assert_allclose(balance.colours, 1.0)


def test_gains_follow_by_their_step_and_arrive() -> None:
    balance, reds = WhiteBalance(), []
    for _ in range(30):
        balance.take(WARM)
        reds.append(balance.colours[2] / balance.colours[1])
        balance.follow(WARM)
    assert np.abs(np.diff(np.log(reds))).max() <= np.log(1.0 + GAIN_STEP) + 1e-12
    assert reds[-1] == pytest.approx(1.0)
