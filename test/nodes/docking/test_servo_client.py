"""The servo as the dock node hears it: by its diagnostics, phase and reason together."""

from bench import Bench
from diagnostic_msgs.msg import DiagnosticArray

from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.messages import diagnostics
from visual_servo_epipolar.messages.diagnostics import Words
from visual_servo_epipolar.nodes.dock_server import ServoClient


def test_phase_reason_and_armed_are_heard_of_this_servo_alone(bench: Bench) -> None:
    heard, armed = [], []
    say = bench.talk(DiagnosticArray, '/diagnostics')
    client = ServoClient(
        bench.probe, lambda *it: heard.append(it), lambda *_: None, lambda: armed.append(True)
    )
    client.configure()
    waits = ServoState()
    failed = waits.changed(phase=Phase.FAILED, reason='the camera is gone')
    say(diagnostics.diagnosis(waits, 1, name='/servo_node', words=Words(armed=True)))
    say(diagnostics.diagnosis(failed, 2, name='/robot2/servo_node'))
    say(diagnostics.diagnosis(failed, 3, name='/servo_node'))
    bench.until(lambda: bool(heard), 'the failure')
    assert (heard, armed) == ([(Phase.FAILED, 'the camera is gone')], [True])
