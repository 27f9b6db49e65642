"""Whatever comes to the servo: it lives, moves nobody outside of a run, and stays small."""

import fuzzing
import numpy as np
from servo_rig import AWAY, CAMERA, PERIOD_NS, Rig, STAMP_NS, tracks
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.servoing.commands import Commands

MAX_LINEAR, MAX_ANGULAR = 0.4, 0.5


class Fuzzed(Rig):
    """A servo that is told nonsense, and each twist that it commands."""

    def __init__(self, bench, monkeypatch, **values) -> None:
        super().__init__(bench, stale_timeout=60.0, **values)
        self.sent = []
        send = Commands.send

        def listen(commands, command, stamp_ns) -> None:
            self.sent.append((command.twist, self.node._run.active, self.node._state.phase))
            send(commands, command, stamp_ns)

        monkeypatch.setattr(Commands, 'send', listen)

    def hear(self, topic: str, message) -> None:
        """Hand a message to all that subscribe to ``topic``, as it comes by the wire."""
        message = fuzzing.wired(message)
        for item in list(self.node.subscriptions):
            if item.topic_name == topic:
                item.callback(message)

    def calm(self) -> None:
        """Make the nonsense of before undone."""
        self.node._run.stop()
        self.hear('/stop_button', Bool(data=False))
        self.hear('/camera_info', write.camera_info(CAMERA, 0, 'camera'))

    def order(self, name: str) -> bool:
        """Call a service as it is called by the wire; return its success."""
        (service,) = (it for it in self.node.services if it.srv_name.endswith(f'/{name}'))
        return bool(service.callback(Trigger.Request(), Trigger.Response()).success)

    def drives(self) -> bool:
        """Return whether a run that begins now moves the robot."""
        self.calm()
        self.hear('/tracks', tracks(AWAY, STAMP_NS - PERIOD_NS))
        assert self.order('start')
        count = len(self.sent)
        for number in range(5):
            self.hear('/tracks', tracks(AWAY, STAMP_NS + number * PERIOD_NS))
        return any(twist != STANDSTILL for twist, *_ in self.sent[count:])


def nonsense(rig: Fuzzed, rng) -> None:
    """Send one message to each subscription."""
    for topic, kind in {(it.topic_name, it.msg_type) for it in rig.node.subscriptions}:
        rig.hear(topic, fuzzing.anything(kind, rng))
    rig.hear('/camera_info', fuzzing.nearly_camera(rng))
    rig.hear('/tracks', fuzzing.nearly_tracks(rng, int(rng.integers(0, 2**33))))


def check(rig: Fuzzed) -> None:
    """Hold what was commanded against limits, and against the run that it belongs to."""
    for twist, active, phase in rig.sent:
        assert abs(twist.linear) <= MAX_LINEAR and abs(twist.angular) <= MAX_ANGULAR
        assert twist == STANDSTILL or (active and phase.drives)
    rig.sent.clear()


def test_outside_of_a_run_nothing_moves_the_robot(bench, monkeypatch) -> None:
    rig = Fuzzed(bench, monkeypatch, autostart=False)

    def run(count: int) -> float:
        rng = np.random.default_rng(0)
        for _ in range(count):
            nonsense(rig, rng)
        assert all(twist == STANDSTILL for twist, *_ in rig.sent)
        check(rig)
        return fuzzing.resident_mb()

    first = run(fuzzing.COUNT // 2)
    assert run(fuzzing.COUNT // 2) - first < fuzzing.GROWTH_MB
    assert rig.drives()


def test_in_a_run_the_robot_keeps_to_its_limits(bench, monkeypatch) -> None:
    rig = Fuzzed(bench, monkeypatch)

    def run(count: int) -> float:
        rng = np.random.default_rng(1)
        stamp_ns, moved = STAMP_NS, 0
        for _ in range(count):
            rig.calm()
            rig.hear('/tracks', tracks(AWAY, stamp_ns))
            assert rig.order('start')
            for _ in range(3):
                stamp_ns += PERIOD_NS
                rig.hear('/tracks', tracks(AWAY, stamp_ns))
            moved += rig.node._state.twist != STANDSTILL
            nonsense(rig, rng)
            check(rig)
        assert moved > count // 2
        return fuzzing.resident_mb()

    first = run(fuzzing.COUNT // 2)
    assert run(fuzzing.COUNT // 2) - first < fuzzing.GROWTH_MB
