"""The watchdog: what it means to lose the tracks, and that no run holds for ever."""

from diagnostic_msgs.msg import DiagnosticArray
import pytest
from sensor_msgs.msg import CameraInfo
from servo_rig import AWAY, HandSetClock, PERIOD_NS, Rig, STAMP_NS, tracks
from std_msgs.msg import String

from visual_servo_epipolar.core.geometry.motion import integrate, STANDSTILL
from visual_servo_epipolar.core.laws.command import HALT
from visual_servo_epipolar.core.laws.phases.standing import RESUMING_FRAMES
from visual_servo_epipolar.messages import event_log, read
from visual_servo_epipolar.nodes import servo_node

OK, WARN, ERROR = b'\x00', b'\x01', b'\x02'


def statuses(heard: list[DiagnosticArray]) -> list[tuple[bytes, str]]:
    return [(item.status[0].level, item.status[0].message) for item in heard]


def test_tracks_that_stay_away_are_lost(bench) -> None:
    events = bench.listen(String, 'servo_node/events')
    phases = bench.listen(String, 'phase')
    rig = Rig(bench, stale_timeout=0.2)
    rig.send(tracks())
    bench.until(lambda: bool(phases) and phases[-1].data == 'holding', 'the robot to hold')
    bench.settle()
    assert (rig.node._state.command, rig.twists()[-1]) == (HALT, STANDSTILL)
    assert rig.node._state.reason.startswith('no new tracks for 0.')
    entries = [event_log.from_text(item.data) for item in events]
    assert [(item.event, item.after_stamp_ns) for item in entries] == [
        ('halted', STAMP_NS),
        ('lost', STAMP_NS),
    ]


def test_a_gap_late_in_a_phase_is_no_end_of_the_run(bench) -> None:
    rig = Rig(bench, stale_timeout=1.0, holding_timeout=5.0)
    pose = AWAY
    for _ in range(90):  # 8.2 s by the stamps
        rig.see(pose)
        pose = integrate(pose, rig.node._state.twist, PERIOD_NS / 1e9)
    assert rig.node._state.phase.drives
    assert rig.stamp_ns - rig.node._state.run.phase_start_ns > 5.0e9  # longer than it may hold
    bench.until(lambda: rig.phase == 'holding', 'the robot to hold')
    rig.stamp_ns += 1_200_000_000
    for _ in range(RESUMING_FRAMES):
        assert rig.phase == 'holding'
        rig.see(pose)
    assert rig.node._state.phase.drives


@pytest.mark.parametrize('hanging', [False, True], ids=['silent', 'hanging camera'])
def test_a_run_whose_tracks_never_come_back_fails(bench, hanging) -> None:
    diagnostics = bench.listen(DiagnosticArray, '/diagnostics')
    rig = Rig(bench, stale_timeout=0.1, holding_timeout=0.3)
    rig.send(tracks())

    def failed() -> bool:
        if hanging:
            rig.send(tracks())
        return rig.phase == 'failed'

    bench.until(failed, 'the run to end')
    reason = rig.node._state.reason
    assert reason.startswith('tracks lost or untrusted for 0.3 s: ')
    bench.until(lambda: (ERROR, f'failed: {reason}') in statuses(diagnostics), 'the verdict')
    assert rig.twists()[-1] == STANDSTILL


def test_a_robot_that_holds_in_silence_is_told_again_and_again_to_stand(bench) -> None:
    rig = Rig(bench, stale_timeout=0.1, holding_timeout=60.0)
    rig.send(tracks())
    bench.until(lambda: rig.phase == 'holding', 'the robot to hold')
    bench.settle()
    told = len(rig.commands)
    bench.until(lambda: len(rig.commands) > told + 3, 'more zero twists')
    assert all(twist == STANDSTILL for twist in rig.twists()[told:])


def a_second_later(freshness) -> None:
    """Let its clock be set by hand, to a second from now."""
    clock = HandSetClock()
    clock.now_ns = freshness.clock.now().nanoseconds + 10**9
    freshness.clock = clock


def test_new_tracks_are_what_keeps_the_watchdog_quiet(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0).drive()
    freshness = rig.node._run.freshness
    a_second_later(freshness)
    rig.tell(tracks(stamp_ns=rig.node._run.stamp_ns))
    assert freshness.age > 0.9  # the last ones again are no new ones
    rig.see()
    assert freshness.age == 0.0


def test_a_step_is_what_ends_the_silence(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0).drive()
    run = rig.node._run
    a_second_later(run.freshness)
    assert run.freshness.idle > 0.9
    run.advance(run.session, rig.stamp_ns, 'camera')
    assert run.freshness.idle == 0.0


ENDS = {
    'lost': lambda run: run.lose('no new tracks'),
    'timed out': lambda run: run.time_out(5.0),
    'stopped': lambda run: run.stop(),
    'reset': lambda run: run.reset(),
}


@pytest.mark.parametrize('end', ENDS.values(), ids=ENDS)
def test_whatever_interrupts_a_run_the_base_is_told_to_stand(bench, end) -> None:
    rig = Rig(bench, stale_timeout=60.0).drive()
    told = len(rig.commands)
    end(rig.node._run)
    bench.until(lambda: len(rig.commands) > told, 'the zero twist')
    assert rig.twists()[told:] == [STANDSTILL]
    assert rig.node._state.command == HALT


def test_a_robot_that_waits_does_not_fail_in_silence(bench) -> None:
    rig = Rig(bench, stale_timeout=0.05, holding_timeout=0.1)
    clock = rig.node._run.freshness.clock
    begin = clock.now().nanoseconds
    bench.until(lambda: clock.now().nanoseconds > begin + 0.4e9, 'some looks of the watchdog')
    assert rig.phase == 'waiting'


def test_diagnostics_tell_of_each_interruption(bench, monkeypatch) -> None:
    monkeypatch.setattr(servo_node, 'IDLE_PERIOD_S', 1000.0)  # at once, not when it looks next
    diagnostics = bench.listen(DiagnosticArray, '/diagnostics')
    rig = Rig(bench, stale_timeout=60.0).drive()

    def told(level: bytes, text: str) -> None:
        bench.until(lambda: any(a == level and text in b for a, b in statuses(diagnostics)), text)
        diagnostics.clear()

    told(OK, 'displacing')
    rig.node._run.lose('no new tracks for 0.51 s')
    told(WARN, 'holding: no new tracks for 0.51 s')
    bench.call('servo_node/stop')
    told(OK, 'waiting: stands until /servo_node/start is called')
    assert bench.call('servo_node/start').success
    told(OK, 'armed, drives as soon as the next image comes')
    rig.calibrate(CameraInfo())
    bench.until(lambda: rig.node._camera.model is None, 'camera_info to arrive')
    rig.see()
    rig.node._on_idle()
    rig.node._run.report()
    told(WARN, 'armed, will drive once this is resolved: camera_info cannot be used')


def test_an_idle_servo_says_once_a_second_why_it_stands(bench, monkeypatch) -> None:
    monkeypatch.setattr(servo_node, 'IDLE_PERIOD_S', 0.05)
    diagnostics = bench.listen(DiagnosticArray, '/diagnostics')
    rig = Rig(bench, stale_timeout=0.1)
    text = 'armed, will drive once this is resolved: no tracks have come yet'
    bench.until(
        lambda: [a for a, b in statuses(diagnostics) if text in b][:3] == [WARN] * 3, 'its reports'
    )
    assert not any(read.is_of_step(read.diagnosis(item)) for item in diagnostics)
    assert rig.commands == []


def test_a_servo_that_drives_says_nothing_beside_its_steps(bench) -> None:
    diagnostics = bench.listen(DiagnosticArray, '/diagnostics')
    rig = Rig(bench, stale_timeout=60.0).drive()
    bench.until(lambda: bool(diagnostics), 'diagnostics')
    diagnostics.clear()
    rig.node._on_idle()
    bench.settle()
    assert diagnostics == []


def test_refused_stamps_are_in_the_diagnostics(bench) -> None:
    diagnostics = bench.listen(DiagnosticArray, '/diagnostics')
    rig = Rig(bench, stale_timeout=60.0, max_latency=0.5)
    rig.see()
    rig.node._run.report()
    bench.until(
        lambda: any(a == WARN and 'the clock of the servo' in b for a, b in statuses(diagnostics)),
        'the reason',
    )
