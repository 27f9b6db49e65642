"""What pairs of views tell of the attitude adds up, but never to more than twice what one does."""

from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import floats

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.rigs.pan_tilt import PanTiltHead
from visual_servo_epipolar.core.rigs.rig import HeadLimits, Joints
from visual_servo_epipolar.core.twoview.estimator import Attitude, COLD_DEVIATION, MOST_CORRELATED
from visual_servo_epipolar.core.twoview.memory import KNOWN_DEVIATION, learnt_attitude
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.simulation.rigs import CameraMount

ABOVE = 0.01  # of deviations: the floor never counts [rad]
PAIRS = 30


def informed(before: Attitude, information: np.ndarray) -> Attitude:
    """Return what an estimator concludes of a pair that tells ``information``, shape (2, 2)."""
    return before.known_to(np.linalg.inv(np.linalg.inv(before.covariance) + information))


def information_of(first: float, second: float, correlation: float) -> np.ndarray:
    """Return the information of measured tilt and roll by their deviations [rad]."""
    return np.linalg.inv(Attitude(0.0, 0.0, first, second, 0.0, correlation).covariance)


def told(before: Attitude, information: np.ndarray, times: int = PAIRS) -> Attitude:
    """Return what is known after the same pair ``times`` again."""
    for _ in range(times):
        before = learnt_attitude(before, informed(before, information))
    return before


def assert_positive_definite(covariance: np.ndarray) -> None:
    np.testing.assert_array_equal(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance)[0] > 0.0


def deviations(low: float, high: float) -> st.SearchStrategy[float]:
    """Return deviations of every order of magnitude [rad]."""
    return floats(math.log(low), math.log(high)).map(math.exp)


def attitudes(least: float = 2e-3) -> st.SearchStrategy[Attitude]:
    within = deviations(least, 0.3)
    angle = floats(-0.5, 0.5)
    return st.builds(Attitude, angle, angle, within, within, st.just(1e-3), floats(-0.9, 0.9))


def information_matrices(least: float = 3e-3) -> st.SearchStrategy[np.ndarray]:
    within = deviations(least, 1.0)
    return st.builds(information_of, within, within, floats(-0.9, 0.9))


def test_the_covariance_has_tilt_roll_and_their_correlation() -> None:
    covariance = Attitude(0.1, 0.2, 0.02, 0.03, 0.0, -0.5).covariance
    np.testing.assert_allclose(covariance, [[4e-4, -3e-4], [-3e-4, 9e-4]], rtol=1e-12)


@given(attitudes(), attitudes())
def test_an_attitude_is_known_to_the_covariance_it_is_told(one: Attitude, other: Attitude) -> None:
    known = one.known_to(other.covariance)
    np.testing.assert_allclose(known.covariance, other.covariance, rtol=1e-9)
    assert (known.tilt, known.roll, known.jitter) == (one.tilt, one.roll, one.jitter)


@given(attitudes(ABOVE), information_matrices(ABOVE))
def test_no_number_of_pairs_tells_more_than_twice_what_one_does(before, information) -> None:
    found = told(before, information).covariance
    bound = np.linalg.inv(np.linalg.inv(before.covariance) + 2.0 * information)
    # What is known before counts too: no direction is known better than by both.
    root = np.linalg.cholesky(np.linalg.inv(bound))
    assert np.linalg.eigvalsh(root.T @ found @ root)[0] > 1.0 - 1e-6


@given(attitudes(ABOVE), information_matrices(ABOVE))
def test_nothing_that_was_known_is_lost(before: Attitude, information: np.ndarray) -> None:
    found = learnt_attitude(before, informed(before, information)).covariance
    root = np.linalg.cholesky(np.linalg.inv(before.covariance))
    assert np.linalg.eigvalsh(root.T @ found @ root)[-1] < 1.0 + 1e-6


@pytest.mark.parametrize('angle', [0.0, 0.5, 1.0, 2.0])
def test_what_a_pair_does_not_tell_stays_as_it_was_known(angle: float) -> None:
    along = np.array([math.cos(angle), math.sin(angle)])
    across = np.array([-along[1], along[0]])
    before = Attitude(0.0, 0.0, 0.02, 0.02)
    found = told(before, np.outer(along, along) / 0.005**2).covariance
    assert across @ found @ across == pytest.approx(0.02**2, rel=1e-6)
    assert along @ found @ along == pytest.approx(0.5 * 0.005**2, rel=1e-6)
    other = told(before.known_to(found), np.outer(across, across) / 0.005**2).covariance
    assert along @ other @ along == pytest.approx(0.5 * 0.005**2, rel=1e-6)
    assert across @ other @ across == pytest.approx(0.5 * 0.005**2, rel=1e-6)


@given(attitudes(), deviations(1e-6, 1e-2), deviations(1e-6, 1e-2), floats(-0.99, 0.99))
def test_no_attitude_is_known_better_than_the_floor(before, first, second, correlation) -> None:
    found = told(before, information_of(first, second, correlation), times=5)
    assert min(found.tilt_deviation, found.roll_deviation) >= KNOWN_DEVIATION * (1.0 - 1e-12)
    assert abs(found.correlation) <= MOST_CORRELATED
    assert_positive_definite(found.covariance)


def test_an_attitude_that_was_estimated_anew_is_no_surer_than_that() -> None:
    wrong = Attitude(0.0, 0.0, KNOWN_DEVIATION, KNOWN_DEVIATION)
    anew = Attitude(0.3, 0.05, 0.03, 0.03)
    found = learnt_attitude(wrong, anew)
    assert (found.tilt, found.tilt_deviation, found.roll_deviation) == (0.3, 0.03, 0.03)


LEAN = CameraMount(tilt=0.04, roll=-0.02)
COLD, JITTER = Attitude(), Attitude().jitter
KNOWN = Attitude(LEAN.tilt, LEAN.roll, 1e-4, 1e-4)
PANS = [-1.5, -0.4, 0.9]
WORLD = np.random.default_rng(3).standard_normal((20, 3))


def through(pan: float) -> np.ndarray:
    """Return the scene as the camera sees it with its joint at ``pan``."""
    return WORLD @ LEAN.R_world_camera(Pose(0.0, 0.0, pan))


def seen(pan: float, photograph: float = 0.0) -> Observation:
    head = PanTiltHead(HeadLimits(photograph=Joints(photograph)))
    view = Observation(0, through(pan), through(photograph), 769.0)
    return view.on_rig(head, Joints(pan))


@pytest.mark.parametrize('pan', PANS)
def test_rays_of_a_known_lean_are_those_of_the_virtual_camera(pan: float) -> None:
    view = seen(pan, photograph=0.3).levelled(KNOWN, COLD)
    virtual = through(0.0)
    for rays in (view.current, view.desired):
        np.testing.assert_allclose(rays, virtual, atol=2e-5)
    view = seen(pan)
    assert np.abs(view.current - virtual).max() > 0.01
    # of a lean that is not known yet
    np.testing.assert_allclose(view.levelled(COLD, COLD).current, view.current, atol=1e-12)


@pytest.mark.parametrize('pan', PANS)
def test_jitter_grows_with_the_doubt_and_the_turn_of_the_head(pan: float) -> None:
    known = seen(pan).jitter(KNOWN)
    assert known == pytest.approx(JITTER, rel=0.02)
    doubtful = seen(pan).jitter(replace(KNOWN, tilt_deviation=0.5))
    turned = 2.0 * abs(math.sin(0.5 * pan)) * COLD_DEVIATION
    assert doubtful == pytest.approx(math.hypot(JITTER, turned), rel=0.02)


def test_where_the_photograph_was_taken_and_without_a_head_the_floor_alone_counts() -> None:
    assert seen(0.3, photograph=0.3).jitter(COLD) == pytest.approx(JITTER)
    fixed = Observation(0, WORLD, WORLD, 769.0)
    assert fixed.jitter(COLD) == COLD.jitter
    assert fixed.levelled(KNOWN, COLD) is fixed
