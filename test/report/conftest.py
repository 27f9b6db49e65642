"""A run by point features, which arrives."""

import pytest

from visual_servo_epipolar.core.servo.run_log import RunLog
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.simulation.views import drive


@pytest.fixture(scope='session')
def log() -> RunLog:
    return drive(Scenario(), (-0.6, -3.0, 8.0), 7)
