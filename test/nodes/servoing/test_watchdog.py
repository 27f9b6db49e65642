"""The watchdog: what it means to lose the tracks, that no run holds for ever, and why it does."""

from lifecycles import go
import pytest
from sensor_msgs.msg import CameraInfo
from servo_rig import AWAY, GOAL, PERIOD_NS, Rig, some, STAMP_NS, tracks
from std_msgs.msg import Bool, String

from visual_servo_epipolar.core.geometry.motion import integrate, STANDSTILL
from visual_servo_epipolar.core.laws.standing import RESUMING_FRAMES
from visual_servo_epipolar.messages import event_log, read
from visual_servo_epipolar.nodes import servo_node
from visual_servo_epipolar.nodes.driving_inputs import NO_CAMERA

OK, WARN, ERROR = b'\x00', b'\x01', b'\x02'


def statuses(rig: Rig) -> list[tuple[bytes, str]]:
    return [(item.status[0].level, item.status[0].message) for item in rig.reports]


def test_tracks_that_stay_away_are_lost(bench) -> None:
    events = bench.listen(String, 'servo_node/events')
    rig = Rig(bench, stale_timeout=0.2)
    rig.send(tracks())
    bench.until(lambda: rig.words and rig.words[-1].data == 'holding', 'the robot to hold')
    bench.settle()
    assert rig.twist == STANDSTILL
    assert rig.reason.startswith('no new tracks for ')
    entries = [event_log.from_text(item.data) for item in events]
    told = [(item.event, item.after_stamp_ns) for item in entries]
    assert told == [('halted', STAMP_NS), ('lost', STAMP_NS)]


def test_a_gap_late_in_a_phase_is_no_end_of_the_run(bench) -> None:
    rig = Rig(bench, stale_timeout=1.0, holding_timeout=5.0)
    pose = AWAY
    for _ in range(90):  # 8.2 s by the stamps
        rig.see(pose)
        pose = integrate(pose, rig.twist, PERIOD_NS / 1e9)
    assert rig.drives
    assert len({word.data for word in rig.words[-56:]}) == 1  # 5 s: longer than it may hold
    bench.until(lambda: rig.phase == 'holding', 'the robot to hold')
    rig.stamp_ns += 1_200_000_000
    rig.resume(pose)


@pytest.mark.parametrize('hanging', [False, True], ids=['silent', 'hanging camera'])
def test_a_run_whose_tracks_never_come_back_fails(bench, hanging) -> None:
    rig = Rig(bench, stale_timeout=0.1, holding_timeout=0.3)
    rig.send(tracks())

    def failed() -> bool:
        if hanging:
            rig.send(tracks())
        return rig.phase == 'failed'

    bench.until(failed, 'the run to end')
    reason = rig.reason
    assert reason.startswith('tracks lost or untrusted for 0.3 s: ')
    bench.until(lambda: (ERROR, f'failed: {reason}') in statuses(rig), 'the verdict')
    assert rig.twists()[-1] == STANDSTILL


def test_a_robot_that_holds_in_silence_is_stopped_again_and_again(bench) -> None:
    rig = Rig(bench, stale_timeout=0.1, holding_timeout=60.0)
    rig.send(tracks())
    bench.until(lambda: rig.phase == 'holding', 'the robot to hold')
    bench.settle()
    told = len(rig.commands)
    bench.until(lambda: len(rig.commands) > told + 3, 'more zero twists')
    assert all(twist == STANDSTILL for twist in rig.twists()[told:])


@pytest.mark.parametrize('phase', ['waiting', 'arrived'])
def test_a_robot_that_waits_or_has_arrived_is_left_alone_in_silence(bench, phase) -> None:
    rig = Rig(bench, stale_timeout=0.05, holding_timeout=0.1, memory=False)
    if phase == 'arrived':
        rig.see(GOAL)
    bench.pass_time(0.4)  # some looks of the watchdog
    assert (rig.phase, rig.twists()) == (phase, [STANDSTILL] * (phase == 'arrived'))


def test_each_interruption_is_in_the_diagnostics(bench, clock, monkeypatch) -> None:
    monkeypatch.setattr(servo_node, 'IDLE_PERIOD_S', 1000.0)  # at once, not when it looks next
    rig = Rig(bench).drive()

    def told(level: bytes, text: str) -> None:
        bench.until(lambda: any(a == level and text in b for a, b in statuses(rig)), text)
        rig.reports.clear()

    told(OK, 'displacing')
    rig.run.lose('no new tracks for 0.51 s')
    told(WARN, 'holding: no new tracks for 0.51 s')
    bench.call('servo_node/stop')
    told(OK, 'waiting: stands until /servo_node/start is called')
    assert bench.call('servo_node/start').success
    told(OK, 'armed, drives as soon as the next image comes')
    rig.hear(CameraInfo())
    rig.see()
    rig.idle()
    rig.run.report()
    told(WARN, 'armed, will drive once this is resolved: camera_info cannot be used')


def test_an_idle_servo_says_once_a_second_why_it_stands(bench, monkeypatch) -> None:
    monkeypatch.setattr(servo_node, 'IDLE_PERIOD_S', 0.05)
    rig = Rig(bench, stale_timeout=0.1)
    text = 'armed, will drive once this is resolved: no tracks have come yet'
    bench.until(
        lambda: [a for a, b in statuses(rig) if text in b][:3] == [WARN] * 3, 'its reports'
    )
    assert not any(read.is_of_step(read.diagnosis(item)) for item in rig.reports)
    assert rig.commands == []


def test_a_servo_that_drives_says_nothing_beside_its_steps(bench) -> None:
    rig = Rig(bench).drive()
    bench.until(lambda: bool(rig.reports), 'diagnostics')
    rig.reports.clear()
    rig.idle()
    bench.settle()
    assert rig.reports == []


TIMEOUT_S = 0.5


class Enabled(Rig):
    """A servo that drives while it is enabled."""

    def __init__(self, bench, **values) -> None:
        self.say = bench.talk(Bool, 'enable')
        super().__init__(bench, **{'enable_timeout': TIMEOUT_S, **values})

    def enable(self, value: bool = True) -> None:
        self.say(Bool(data=value))
        self.bench.settle()

    def drive(self) -> 'Enabled':
        self.enable()
        super().drive()
        return self


def test_without_a_heartbeat_no_run_begins_and_that_is_said(bench, clock) -> None:
    rig = Enabled(bench)
    rig.see()
    assert (rig.phase, rig.commands) == ('waiting', [])
    answer = bench.call('servo_node/start')
    text = 'armed, will drive once this is resolved: no message has come on /enable yet'
    assert text in answer.message
    rig.drive()


def test_a_heartbeat_that_ends_stops_the_robot_and_it_goes_on_with_the_next(bench, clock) -> None:
    rig = Enabled(bench).drive()
    clock.go_on(TIMEOUT_S - 0.1)
    rig.watch()
    assert rig.drives
    clock.go_on(0.2)
    bench.until(lambda: rig.phase == 'holding', 'the robot to hold, without any image')
    bench.settle()
    assert rig.twists()[-1] == STANDSTILL
    assert 'the last true on /enable is 0.6 s old' in rig.reason
    rig.stand(RESUMING_FRAMES)
    rig.enable()
    rig.resume()


def test_a_false_counts_also_while_the_node_is_inactive(bench, clock) -> None:
    rig = Enabled(bench).drive()
    go(bench, rig.node, 'deactivate')
    rig.enable(value=False)
    go(bench, rig.node, 'activate')
    told = len(rig.commands)
    for _ in range(3):
        rig.see()
    assert rig.twists()[told:] == []
    assert rig.reason.endswith('/enable is false')


def test_a_false_is_not_lost_by_a_true_that_comes_before_it_is_heard(bench, clock) -> None:
    rig = Enabled(bench, resume='manual').drive()
    rig.say(Bool(data=False))
    rig.enable()
    assert rig.phase == 'holding'


def test_without_enable_timeout_no_heartbeat_is_heard(bench, clock) -> None:
    rig = Enabled(bench, enable_timeout=0.0)
    rig.drive().enable(value=False)
    assert rig.drives


def test_a_hold_for_want_of_it_ends_as_any_other(bench) -> None:
    times = {'holding_timeout': 0.3, 'stale_timeout': 0.1, 'enable_timeout': 10.0}
    rig = Enabled(bench, **times)
    rig.enable()
    rig.see()
    rig.enable(value=False)
    bench.until(lambda: rig.phase == 'failed', 'the run to end')
    assert rig.reason == 'held for 0.3 s: /enable is false'


@pytest.mark.parametrize('resume', ['automatic', 'manual'])
@pytest.mark.parametrize('tracks_come', [True, False], ids=['of nothing', 'none'])
def test_after_a_hold_the_robot_goes_on_by_itself_or_by_a_start(
    bench, tracks_come, resume
) -> None:
    rig = Rig(bench, resume=resume).drive()
    if tracks_come:
        rig.show()
    else:
        rig.run.lose('no new tracks for 0.51 s')
    assert rig.phase == 'holding'
    if resume == 'automatic':
        rig.resume()
    else:
        rig.stand(3 * RESUMING_FRAMES)
        assert rig.phase == 'holding'
        rig.run.report()
        assert rig.reason.startswith('resume is manual: ')
        answer = bench.call('servo_node/start')
        assert (answer.success, answer.message) == (True, 'started')
        rig.see()
        assert rig.twist != STANDSTILL


def test_without_a_camera_that_is_the_reason_though_tracks_stay_away_too(bench) -> None:
    rig = Rig(bench, calibrated=False, stale_timeout=0.1)
    bench.pass_time(0.15)
    rig.run.report()
    assert rig.reason == f'will drive once this is resolved: {NO_CAMERA}'
    assert rig.phase == 'waiting'


def test_a_robot_that_holds_stands_for_the_latest_reason(bench, clock) -> None:
    rig = Rig(bench).drive()
    rig.run.refuse('an image of last year')
    rig.run.trouble = 'an image of this year'
    assert (rig.phase, rig.reason) == ('holding', 'an image of last year')
    rig.run.report()
    assert rig.reason == 'an image of this year'


@pytest.mark.parametrize(
    ('refused', 'seconds', 'reason'),
    [(True, 0.4, 'an image of last year, 0.4 s ago'), (False, 4.9, 'no tracks for 4.9 s')],
)
def test_a_run_fails_for_the_latest_reason_with_its_age(
    bench, clock, refused, seconds, reason
) -> None:
    rig = Rig(bench).drive()
    rig.run.lose('no new tracks for 0.51 s')
    if refused:
        rig.run.refuse('an image of last year')
    clock.go_on(seconds)
    rig.run.time_out(5.0)
    assert rig.reason == f'tracks lost or untrusted for 5 s: {reason}'


@pytest.mark.parametrize('count', [3, 0], ids=['few', 'none'])
def test_a_hold_that_images_end_has_the_reason_of_the_last_of_them(bench, count) -> None:
    rig = Rig(bench, holding_timeout=1.0).drive()
    rig.run.lose('no new tracks for 0.51 s')
    rig.goal = 1
    while rig.phase == 'holding':
        rig.show(some(count))
    text = f'tracks lost or untrusted for 1 s: {count} features, 12 needed, 0.0 s ago'
    assert (rig.phase, rig.reason) == ('failed', text)
