"""Bounds of a phase survive the loss of tracks; what belongs to another way is forgotten."""

from dataclasses import replace
import math

import numpy as np
import pytest
from servo_states import BEARINGS, in_phase, SETTINGS, sight, then

from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.laws.standing import RESUMING_FRAMES
from visual_servo_epipolar.core.odometry.legs import Leg
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.twoview.estimator import UNKNOWN_COVARIANCE

ASIDE = replace(BEARINGS, psi=-0.1, phi=-0.1 - math.pi / 2.0)
NO_ESTIMATE = sight(bearings=None, difference=math.nan, reason='two geometries fit')


def test_backing_off_goes_on_counting_after_tracks_were_lost() -> None:
    state = then(in_phase(Phase.RETREATING, travel=-9.5, reversed=9.5), NO_ESTIMATE)
    assert state.phase is Phase.HOLDING
    aside = sight(2, bearings=ASIDE)
    for number in range(RESUMING_FRAMES):
        assert state.phase is Phase.HOLDING
        state = then(state, replace(aside, stamp_ns=sight(2 + number).stamp_ns))
    assert state.phase is Phase.RETREATING
    assert (state.run.travel, state.motion.reversed) == (pytest.approx(-9.5), 9.5)


def test_who_backs_off_begins_a_way_of_his_own() -> None:
    aside = sight(bearings=ASIDE)
    leg = Leg(0.3, 1.0)
    state = then(in_phase(Phase.ZEROING_EPIPOLES, leg=leg), aside)
    assert state.phase is Phase.RETREATING
    assert state.law.leg is None


def test_an_estimator_without_covariance_tells_nothing_of_the_mount() -> None:
    settings = replace(SETTINGS, camera_forward=0.2, camera_yaw=0.1)
    blind = {'deviation': math.nan, 'covariance': UNKNOWN_COVARIANCE}
    state = ServoState()
    for frame in range(1, 30):
        state = then(state, sight(frame, **blind), settings)
        assert np.isfinite(state.identified.extrinsics.mean).all()
    assert state.phase is not Phase.HOLDING
