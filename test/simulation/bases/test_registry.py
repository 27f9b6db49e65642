"""A base of another kind: a class, a row in the table, and the closed loop drives it."""

from dataclasses import dataclass

import pytest

from visual_servo_epipolar.core.geometry.motion import integrate, Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.core.settings import setting, Settings
from visual_servo_epipolar.simulation.bases.registry import SIMULATED_BASES, SimulatedBaseModel
from visual_servo_epipolar.simulation.scenario import from_document, Scenario
from visual_servo_epipolar.simulation.views import drive


@dataclass(frozen=True, kw_only=True)
class IdealSettings(Settings):
    """A base without inertia; ``gain`` is what becomes of a commanded speed."""

    gain: float = setting(1.0, 'True speed over the commanded one', low=0.1, high=2.0)


class IdealBase:
    """Does at once what it is told."""

    timed_out = False

    def __init__(self, settings: IdealSettings, pose: Pose, *, seed: int, now_ns: int = 0) -> None:
        self.settings, self.pose, self.now_ns, self.twist = settings, pose, now_ns, STANDSTILL

    @property
    def odometry(self) -> Pose:
        return self.pose

    def command(self, command: Command) -> None:
        gain, twist = self.settings.gain, command.twist
        self.twist = Twist(gain * twist.linear, gain * twist.angular)

    def halt(self) -> None:
        self.twist = STANDSTILL

    def advance(self, now_ns: int) -> None:
        self.pose = integrate(self.pose, self.twist, (now_ns - self.now_ns) / 1e9)
        self.now_ns = now_ns


@pytest.fixture
def ideal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SIMULATED_BASES, 'ideal', SimulatedBaseModel(IdealSettings, IdealBase))


@pytest.mark.usefixtures('ideal')
def test_a_base_of_another_kind_drives_to_the_goal() -> None:
    scenario = from_document({'base': {'model': 'ideal', 'gain': 0.9}}, 'test')
    summary = summarise(drive(scenario, (1.0, -3.0, 0.0), 0))
    assert summary['outcome'] == 'arrived'
    # 0.2 px of noise on 60 features.
    assert summary['position_error_m'] < 0.005


@pytest.mark.usefixtures('ideal')
def test_a_scenario_tells_bases_apart_by_name() -> None:
    scenario = from_document({'base': {'model': 'ideal'}}, 'test')
    assert scenario.base == IdealSettings()
    assert scenario.document()['base'] == {'gain': 1.0, 'model': 'ideal'}


def test_the_base_is_a_pioneer_unless_said() -> None:
    assert from_document({'base': {'model': 'pioneer'}}, 'test') == Scenario()
    assert Scenario().document()['base']['model'] == 'pioneer'
