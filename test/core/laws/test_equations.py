"""Control laws one by one; their closed loops are held against the paper in test/theory."""

from dataclasses import dataclass
import math

from drives import drive, Law, RESIDUE, Start
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest
from strategies import floats, pose_with

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import integrate, Twist
from visual_servo_epipolar.core.laws import equations

SIGNS = st.sampled_from([-1.0, 1.0])
ABSCISSAE = st.one_of(floats(-3.0, -0.02), floats(0.02, 3.0))
DISTANCES = floats(0.1, 20.0)
FOCALS = floats(0.2, 5.0)


@given(ABSCISSAE, ABSCISSAE, SIGNS, DISTANCES, FOCALS, floats(0.01, 2.0))
def test_velocities_need_no_unit_of_the_image(e_au, e_du, sigma, d_hat, scale, rate) -> None:
    def control(unit: float) -> Twist:
        nu = (-rate * e_au * unit, rate * e_du * unit)
        return equations.linearizing_control(
            unit * e_au, unit * e_du, sigma=sigma, distance=d_hat, nu=nu, focal=unit
        )

    metric, scaled = control(1.0), control(769.0 * scale)
    assert scaled.linear == pytest.approx(metric.linear, rel=1e-12)
    assert scaled.angular == pytest.approx(metric.angular, rel=1e-12, abs=1e-14)


def test_a_current_epipole_that_is_zero_makes_a_large_speed_not_an_infinite_one() -> None:
    twist = equations.linearizing_control(0.0, 0.3, sigma=-1.0, distance=5.0, nu=(0.0, 0.1))
    assert 1e9 < abs(twist.linear) < math.inf


@given(floats(-1.2, 1.2), floats(-1.2, 1.2), floats(-2.0, 2.0), SIGNS, floats(0.05, 1.0))
def test_the_preliminary_turn_is_exponential_to_its_target(e_au, target, e_du, sigma, k1) -> None:
    pose = pose_with(e_au, e_du, sigma=sigma, distance=2.0)
    dt = 1e-3
    for _ in range(500):
        e_current = Bearings.from_pose(pose).epipole_current
        pose = integrate(pose, equations.turn_epipole(e_current, target, k1=k1), dt)
    expected = target + (e_au - target) * math.exp(-k1 * 0.5)
    after = Bearings.from_pose(pose)
    # Euler's error over 0.5 s in steps of 1 ms, as above.
    assert after.epipole_current == pytest.approx(expected, abs=2e-3 * abs(e_au - target) + 1e-12)
    assert after.epipole_desired == pytest.approx(e_du, abs=1e-12)


@given(
    st.one_of(floats(-3.0, -1e-6), floats(1e-6, 3.0)),
    floats(0.05, 0.95),
    FOCALS,
    floats(0.05, 0.5),
)
def test_the_displaced_epipole_is_discordant_and_within_its_bounds(e_du, room, focal, low) -> None:
    target = equations.displaced_epipole(e_du, ratio=room, low=low, high=low + 0.2, focal=focal)
    assert target * e_du < 0.0
    assert low - 1e-12 <= math.atan(abs(target) / focal) <= low + 0.2 + 1e-12


@dataclass(frozen=True, kw_only=True)
class Spiral(Law):
    """The law that holds e_au at ``target``."""

    target: float

    def nu(self, e_current: float, e_desired: float) -> tuple[float, float]:
        gains = {'k1': self.k1, 'k2': self.k2, 'exponent': self.exponent}
        return equations.auxiliary_controls(e_current, e_desired, **gains, e_target=self.target)


@settings(max_examples=20)
@given(floats(0.1, 0.8), SIGNS, SIGNS, floats(0.3, 0.7), st.booleans())
def test_holding_the_displaced_epipole_spirals_with_room(e_du, sign, sigma, room, ahead) -> None:
    target = equations.displaced_epipole(sign * e_du, ratio=room, low=0.05, high=1.2)
    start = Start(e_current=target, e_desired=sign * e_du, sigma=sigma, distance=3.0, ahead=ahead)
    run = drive(start, Spiral(k1=0.8, k2=0.5, target=target))
    alpha = math.atan(abs(target))
    # ln(d_end / d_0) = -|chi_0| / tan(alpha); the run stops RESIDUE short of chi = 0.
    expected = math.exp(-(math.atan(e_du) - RESIDUE) / math.tan(alpha))
    assert run.distance[-1] / 3.0 == pytest.approx(expected, rel=1e-5)
    assert expected == pytest.approx(room, rel=1e-2)
    assert run.e_current[-1] == pytest.approx(target, rel=1e-6)


@given(floats(0.05, 5.0), floats(0.001, 0.5), SIGNS, floats(0.05, 2.0), floats(0.05, 1.5))
def test_the_braking_speed_is_enough_to_stop(way, bearing, sign, speed, deceleration) -> None:
    # The bearing closes in proportion to the remaining distance, by a scale that nobody knows.
    rate = -sign * bearing * speed / way
    limit = equations.braking_speed(sign * bearing, rate, deceleration=deceleration)
    # At the speed v itself v^2 / (2 a) = way: the bound on v is 2 a way / v.
    assert limit == pytest.approx(2.0 * deceleration * way / speed)
    assert (limit >= speed * (1.0 - 1e-9)) == (speed**2 / (2.0 * deceleration) <= way * (1 + 1e-9))


@pytest.mark.parametrize(('bearing', 'rate'), [(0.1, 0.2), (-0.1, -0.2), (0.1, 0.0), (0.0, 0.3)])
def test_nothing_brakes_a_robot_that_is_not_closing_in(bearing: float, rate: float) -> None:
    assert equations.braking_speed(bearing, rate, deceleration=0.2) == math.inf
