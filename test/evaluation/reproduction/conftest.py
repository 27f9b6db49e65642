"""The two simulations, run once for all tests."""

import pytest

from visual_servo_epipolar.evaluation.reproduction.continuous import (
    Simulation1,
    Simulation2,
    simulation_1,
    simulation_2,
)


@pytest.fixture(scope='session')
def runs_1() -> Simulation1:
    return simulation_1()


@pytest.fixture(scope='session')
def runs_2() -> Simulation2:
    return simulation_2()
