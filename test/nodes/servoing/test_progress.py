"""Progress and result of a run as topics, for who has no action to ask for them."""

import math

from diagnostic_msgs.msg import DiagnosticArray
import pytest
from sensor_msgs.msg import JointState
from servo_rig import AWAY, GOAL, HandSetClock, Rig, some, STAMP_NS
from std_msgs.msg import Bool

from visual_servo_epipolar.core.geometry.motion import integrate, STANDSTILL
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.driving_inputs import NO_CAMERA

PERIOD_S = 0.090909091


def results(bench) -> list[DiagnosticArray]:
    return bench.listen(DiagnosticArray, 'servo_node/result', qos.LATCHED)


def last(bench, heard, word: str) -> dict[str, str]:
    bench.until(lambda: heard and read.diagnosis(heard[-1])['outcome'] == word, word)
    return read.diagnosis(heard[-1])


def test_progress_tells_the_way_left_its_deviation_and_the_attempt(bench) -> None:
    heard = bench.listen(JointState, 'servo_node/progress')
    rig, pose = Rig(bench), AWAY
    for frame in range(80):
        rig.show(rig.world.observe(pose, frame))
        pose = integrate(pose, rig.twist, PERIOD_S)
    bench.until(lambda: len(heard) == 80, 'the progress of each image')
    said = read.telemetry(heard[-1])
    assert read.stamp_ns(heard[0].header) == STAMP_NS
    off = abs(said['remaining_m'] - pose.distance)
    assert 0.0 < said['remaining_deviation_m'] < 0.3
    assert off < max(5.0 * said['remaining_deviation_m'], 0.1)
    assert said['attempt'] == 1.0
    assert said['elapsed_s'] == pytest.approx(79 * PERIOD_S, abs=1e-3)
    assert list(Phase.known)[int(said['phase'])] == rig.phase
    assert math.isfinite(said['heading_error_rad'])


def test_an_arrival_is_a_latched_result(bench) -> None:
    rig = Rig(bench, memory=False).drive()
    early = results(bench)
    assert last(bench, early, 'running')['attempt'] == '1.0'
    assert early[-1].status[0].message.startswith('displacing: the robot turns, to begin step 1')
    bench.call('servo_node/reset')
    assert last(bench, early, 'stopped')['reason'] == 'reset'
    rig.see(GOAL)
    late = results(bench)  # who comes after the end hears it
    assert last(bench, late, 'arrived')['reason'] == 'matched'
    (status,) = late[-1].status
    assert (status.level, status.name) == (b'\x00', '/servo_node')
    assert status.message.startswith('arrived: the robot stands at the goal')


def test_a_failure_says_why(bench) -> None:
    heard = results(bench)
    rig = Rig(bench).drive()
    rig.run.lose('no new tracks for 0.51 s')
    rig.run.time_out(5.0)
    reason = last(bench, heard, 'failed')['reason']
    assert reason.startswith('tracks lost or untrusted for 5 s: ')
    assert heard[-1].status[0].level == b'\x02'
    assert heard[-1].status[0].message == f'failed: {reason}'


def test_who_stops_a_run_is_told_of(bench) -> None:
    heard = results(bench)
    press = bench.talk(Bool, 'stop_button', qos.LATCHED)
    Rig(bench).drive()
    press(Bool(data=True))
    said = last(bench, heard, 'stopped')
    assert said['reason'] == 'the stop button is pressed'
    assert said['elapsed_s'] != 'nan'  # of the run that was stopped
    assert heard[-1].status[0].level == b'\x01'


def test_a_hold_is_no_result(bench) -> None:
    heard = results(bench)
    rig = Rig(bench).drive()
    rig.goal = 1
    rig.show()
    assert rig.phase == 'holding'
    rig.goal = 0
    for _ in range(4):
        rig.see()
    assert rig.drives and rig.twists()[-1] != STANDSTILL
    assert [read.diagnosis(item)['outcome'] for item in heard] == ['running']


def test_without_a_camera_that_is_the_reason_though_tracks_stay_away_too(bench) -> None:
    rig = Rig(bench, calibrated=False, stale_timeout=0.1)
    bench.pass_time(0.15)
    rig.run.report()
    assert rig.reason == f'will drive once this is resolved: {NO_CAMERA}'
    assert rig.phase == 'waiting'


def test_a_robot_that_holds_stands_for_the_latest_reason(bench) -> None:
    rig = Rig(bench).drive()
    rig.run.refuse('an image of last year')
    rig.run.trouble = 'an image of this year'
    assert (rig.phase, rig.reason) == ('holding', 'an image of last year')
    rig.run.report()
    assert rig.reason == 'an image of this year'


def hear_and_wait(run, seconds: float) -> None:
    """Let tracks come, and time pass from then on."""
    run.freshness.clock = clock = HandSetClock()
    run.freshness.hear()
    clock.now_ns += round(seconds * 1e9)


def test_a_run_fails_for_the_latest_reason_with_its_age(bench) -> None:
    rig = Rig(bench).drive()
    run = rig.run
    run.lose('no new tracks for 0.51 s')
    run.refuse('an image of last year')
    hear_and_wait(run, 0.4)
    run.time_out(5.0)
    reason = rig.reason
    assert reason.startswith('tracks lost or untrusted for 5 s: an image of last year, 0.4')


def test_where_tracks_end_in_a_hold_it_fails_for_that(bench) -> None:
    rig = Rig(bench).drive()
    run = rig.run
    run.lose('an image of last year')
    hear_and_wait(run, 4.9)
    run.time_out(5.0)
    assert rig.reason == 'tracks lost or untrusted for 5 s: no tracks for 4.9 s'


@pytest.mark.parametrize('count', [3, 0], ids=['few', 'none'])
def test_a_hold_that_images_end_has_the_reason_of_the_last_of_them(bench, count) -> None:
    rig = Rig(bench, holding_timeout=1.0).drive()
    rig.run.lose('no new tracks for 0.51 s')
    rig.goal = 1
    while rig.phase == 'holding':
        rig.show(some(count))
    text = f'tracks lost or untrusted for 1 s: {count} features, 12 needed, 0.0 s ago'
    assert (rig.phase, rig.reason) == ('failed', text)
