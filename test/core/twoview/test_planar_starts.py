"""Starts of planar motions by essential matrices that know no vertical."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import angles, floats, panorama

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import HALF_PI, Pose
from visual_servo_epipolar.core.twoview.estimator import Attitude
from visual_servo_epipolar.core.twoview.hypotheses import rays_of
from visual_servo_epipolar.core.twoview.planar_motion import (
    matrices,
    PHI,
    PSI,
    ROLL,
    ROLL_JUMP,
    TILT,
    TILT_JUMP,
)
from visual_servo_epipolar.core.twoview.soft_planar import (
    general_start_parameters,
    planar_parameters,
)

WIDE = Attitude(tilt_deviation=math.radians(15.0), roll_deviation=math.radians(5.0))
SIGNS = st.sampled_from([-1.0, 1.0])
# To either side from 12 degrees, of which the vertical is the axis, to 160.
HEADINGS = st.builds(lambda size, sign: size * sign, floats(0.2, 2.8), SIGNS)
TILTS = floats(-math.radians(30.0), math.radians(30.0))
ROLLS = floats(-math.radians(10.0), math.radians(10.0))


def planar(psi: float, phi: float, tilt: float, roll: float) -> np.ndarray:
    """Return E, shape (1, 3, 3), of a planar motion without jumps."""
    parameters = np.zeros((1, 6))
    parameters[0, [PSI, PHI, TILT, ROLL]] = psi, phi, tilt, roll
    return matrices(parameters)[:, 0].reshape(1, 3, 3)


def assert_axes(found: np.ndarray, psi: float, phi: float, tolerance: float) -> None:
    """Compare bearings, of which both may be reversed: a sign of E."""
    turned = np.exp(1j * (found[[PSI, PHI]] - [psi, phi]))
    np.testing.assert_allclose(turned * np.sign(turned[0].real), 1.0, atol=tolerance)


@given(angles(), HEADINGS, TILTS, ROLLS, SIGNS)
def test_an_exact_planar_motion_is_recovered(psi, heading, tilt, roll, sign) -> None:
    phi = psi - heading - HALF_PI
    essential = planar(psi, phi, tilt, roll)
    found = planar_parameters(sign * essential, WIDE)[0]
    # The prior pulls by PLANARITY, in units of the turn: 0.01 at 12 degrees, 1e-4 at right angles.
    tolerance = 0.02
    assert found[TILT] == pytest.approx(tilt, abs=tolerance)
    assert found[ROLL] == pytest.approx(roll, abs=tolerance)
    assert_axes(found, psi, phi, tolerance)
    assert found[TILT_JUMP] == found[ROLL_JUMP] == 0.0
    # The twin turns by half around the baseline: as far from the truth as two turns can be.
    assert abs(math.remainder(found[PSI] - found[PHI] - HALF_PI - heading, math.tau)) < 0.02


@pytest.mark.parametrize(
    ('way', 'tilt', 'roll'),
    [((HALF_PI, 0.0, math.radians(20.0), 0.0), 20.0, 4.0)]
    + [((0.0, -HALF_PI, 0.0, math.radians(8.0)), 5.0, 8.0)],
    ids=['ahead', 'aside'],
)
@pytest.mark.parametrize('sign', [-1.0, 1.0])
def test_a_translation_tells_one_angle_the_prior_the_other(way, tilt, roll, sign) -> None:
    essential = sign * planar(*way)
    prior = replace(WIDE, tilt=math.radians(5.0), roll=math.radians(4.0))
    found = planar_parameters(essential, prior)[0]
    assert math.degrees(found[TILT]) == pytest.approx(tilt, abs=0.3)
    assert math.degrees(found[ROLL]) == pytest.approx(roll, abs=0.3)


@given(angles(), TILTS, ROLLS)
def test_a_translation_of_the_right_attitude_is_recovered(psi, tilt, roll) -> None:
    phi = psi - HALF_PI
    found = planar_parameters(planar(psi, phi, tilt, roll), replace(WIDE, tilt=tilt, roll=roll))
    np.testing.assert_allclose(found[0, [TILT, ROLL]], [tilt, roll], atol=1e-6)
    assert_axes(found[0], psi, phi, 1e-6)


@pytest.mark.parametrize('ray', np.eye(3).tolist())
def test_matches_that_all_coincide_begin_nothing(ray: list[float]) -> None:
    same = np.tile(ray, (8, 1))
    assert general_start_parameters(rays_of(same, same, 1e-3), WIDE).shape == (0, 6)


def test_what_lies_behind_both_cameras_does_no_harm() -> None:
    """Of features all round those that OpenCV cannot take are left out, whatever the turn."""
    pose = Pose.from_start(0.8, -2.0, 150.0)
    found = general_start_parameters(rays_of(*panorama(pose), 1e-3), WIDE)
    true = Bearings.from_pose(pose)
    off = np.abs(np.sin(found[:, [PSI, PHI]] - [true.psi, true.phi])).max(axis=1)
    assert off.min() < 0.05
