"""The servo as the dock node hears it: each phase once, a failure with its reason."""

from collections.abc import Callable
from typing import Any

from bench import Bench
from diagnostic_msgs.msg import DiagnosticArray
import pytest
from std_msgs.msg import String

from visual_servo_epipolar.core.laws.phase import ARMED, Phase
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.messages import diagnostics, write
from visual_servo_epipolar.nodes import dock_server, qos
from visual_servo_epipolar.nodes.dock_server import ServoClient

NO_PATIENCE_S, LONG_S = 0.05, 600.0


class Servo:
    """What a servo says, and what its client is told of it."""

    def __init__(self, bench: Bench) -> None:
        self._bench, self.told, self.armed = bench, [], []
        self.say_word = bench.talk(String, 'phase', qos.LATCHED)
        self._explain = bench.talk(DiagnosticArray, '/diagnostics')
        client = ServoClient(
            bench.probe, 'servo_node', self._tell, lambda *_: None, lambda: self.armed.append(True)
        )
        client.configure()

    def _tell(self, phase: Phase, reason: str) -> None:
        self.told.append((phase, reason))

    def say(self, phase: Phase) -> None:
        self.say_word(write.text(phase.value))
        self._bench.settle()

    def explain(self, phase: Phase, reason: str) -> None:
        state = ServoState().changed(phase=phase, reason=reason)
        self._explain(diagnostics.diagnosis(state, 1, name='/servo_node'))
        self._bench.settle()


@pytest.fixture
def servo(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> Callable[[float], Servo]:
    """Return what makes a servo whose client has so much patience [s]."""

    def make(patience_s: float) -> Servo:
        monkeypatch.setattr(dock_server, 'PATIENCE_S', patience_s)
        return Servo(bench)

    return make


def test_a_failure_is_told_as_soon_as_its_reason_is_known(servo: Any) -> None:
    it = servo(LONG_S)
    it.say(Phase.DISPLACING)
    it.say(Phase.FAILED)
    it.say(Phase.FAILED)  # as a servo does that stands
    assert it.told == [(Phase.DISPLACING, '')]
    it.explain(Phase.DISPLACING, 'a reason of before')
    assert it.told == [(Phase.DISPLACING, '')]
    it.explain(Phase.FAILED, 'the camera is gone')
    assert it.told[1:] == [(Phase.FAILED, 'the camera is gone')]


def test_a_failure_that_is_never_explained_is_told_all_the_same(bench: Bench, servo: Any) -> None:
    it = servo(NO_PATIENCE_S)
    it.say(Phase.FAILED)
    bench.until(lambda: it.told == [(Phase.FAILED, '')], 'the failure')


def test_a_phase_is_told_once_however_often_it_is_explained(servo: Any) -> None:
    it = servo(LONG_S)
    it.say(Phase.HOLDING)
    for _ in range(2):
        it.explain(Phase.HOLDING, 'tracks lost')
    it.say(Phase.DISPLACING)
    assert it.told == [(Phase.HOLDING, ''), (Phase.DISPLACING, '')]


def test_an_order_that_lapses_is_told_with_its_reason(bench: Bench, servo: Any) -> None:
    it = servo(LONG_S)
    it.say_word(write.text(ARMED))
    bench.until(lambda: bool(it.armed), 'that it is armed')
    assert it.told == []
    it.say(Phase.WAITING)
    assert it.told == []
    it.explain(Phase.WAITING, '~/start has expired')
    assert it.told == [(Phase.WAITING, '~/start has expired')]
