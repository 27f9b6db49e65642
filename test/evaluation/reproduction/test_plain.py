"""An independent check: simulation 1 against a plain implementation with no code in common."""

from pathlib import Path

from loaded import loaded
import numpy as np
import pytest

from visual_servo_epipolar.evaluation.reproduction.simulations.continuous import PointCamera
from visual_servo_epipolar.evaluation.reproduction.simulations.runs import Simulation1, transient

AGREEMENT = 1e-6  # m, rad, s, m/s, and of the focal length for epipoles


@pytest.fixture(scope='module')
def plain():
    return loaded(Path(__file__).with_name('plain.py'))


@pytest.fixture(scope='module')
def stages(plain, runs_1: Simulation1):
    time = runs_1.course.column('time', 2)
    return plain.simulation_1(time[-1] - time[0], PointCamera(0.03, 0.03).points)


def test_it_shares_no_code() -> None:
    source = Path(__file__).with_name('plain.py').read_text(encoding='utf-8')
    assert 'visual_servo' not in source


def test_the_desired_epipole_is_zero_at_the_same_time(stages, runs_1: Simulation1) -> None:
    assert runs_1.course.zeroed_at == pytest.approx(stages[3], abs=AGREEMENT)


def test_the_way_to_the_axis_is_the_same(plain, stages, runs_1: Simulation1) -> None:
    course, one = runs_1.course, stages[0]
    rows = transient(course, 'time') <= one.t[-1]
    state = one.sol(transient(course, 'time')[rows])
    names = ('pose.x', 'pose.y', 'pose.theta', 'distance_estimate')
    for name, expected in zip(names, state, strict=True):
        np.testing.assert_allclose(transient(course, name)[rows], expected, atol=AGREEMENT)
    e_current, e_desired = plain.epipoles(*state[:3])
    found = (('reading.e_current', e_current), ('reading.e_desired', e_desired))
    for name, expected in found:
        values = transient(course, name)[rows]
        np.testing.assert_allclose(values, expected, atol=AGREEMENT * plain.F)
    u = np.array([plain.first_step(0, q, 1) for q in state.T])
    forward = u[:, 0] * np.cos(state[2]) + u[:, 1] * np.sin(state[2])
    np.testing.assert_allclose(transient(course, 'twist.linear')[rows], forward, atol=AGREEMENT)
    np.testing.assert_allclose(transient(course, 'twist.angular')[rows], u[:, 2], atol=AGREEMENT)


def test_the_turn_at_its_end_is_the_same(stages, runs_1: Simulation1) -> None:
    course, two = runs_1.course, stages[1]
    time = course.column('time', 1)
    rows = (time >= two.t[0]) & (time <= two.t[-1])
    assert rows.sum() > 500
    theta = course.column('pose.theta', 1)[rows]
    np.testing.assert_allclose(theta, two.sol(time[rows])[2], atol=AGREEMENT)


def test_the_second_step_is_the_same(stages, runs_1: Simulation1) -> None:
    time = runs_1.course.column('time', 2)
    values = runs_1.course.column('pose.distance', 2)
    np.testing.assert_allclose(values, stages[2].sol(time - time[0])[0], atol=AGREEMENT)
