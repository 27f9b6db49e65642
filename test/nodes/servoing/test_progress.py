"""Progress and result of a run as topics, for who has no action to ask for them."""

import math

from diagnostic_msgs.msg import DiagnosticArray
import pytest
from sensor_msgs.msg import JointState
from servo_rig import AWAY, GOAL, Rig, STAMP_NS, WORLD
from std_msgs.msg import Bool

from visual_servo_epipolar.core.geometry.motion import integrate, STANDSTILL
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import qos

PERIOD_S = 0.090909091


def results(bench) -> list[DiagnosticArray]:
    return bench.listen(DiagnosticArray, 'servo_node/result', qos.LATCHED)


def last(bench, heard, word: str) -> dict[str, str]:
    bench.until(lambda: heard and read.diagnosis(heard[-1])['outcome'] == word, word)
    return read.diagnosis(heard[-1])


def test_progress_tells_the_way_left_its_deviation_and_the_attempt(bench) -> None:
    heard = bench.listen(JointState, 'servo_node/progress')
    rig, pose = Rig(bench, stale_timeout=60.0), AWAY
    for frame in range(80):
        rig.tell(write.features(WORLD.observe(pose, frame), rig.stamp_ns, 'camera'))
        rig.stamp_ns += 90_909_091
        pose = integrate(pose, rig.node._state.twist, PERIOD_S)
    bench.until(lambda: len(heard) == 80, 'the progress of each image')
    said = read.telemetry(heard[-1])
    assert read.stamp_ns(heard[0].header) == STAMP_NS
    off = abs(said['remaining_m'] - pose.distance)
    assert 0.0 < said['remaining_deviation_m'] < 0.3
    assert off < max(5.0 * said['remaining_deviation_m'], 0.1)
    assert said['attempt'] == 1.0
    assert said['elapsed_s'] == pytest.approx(79 * PERIOD_S, abs=1e-3)
    assert list(Phase.known)[int(said['phase'])] == rig.node._state.phase.value
    assert math.isfinite(said['heading_error_rad'])


def test_an_arrival_is_a_latched_result(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0, memory=False).drive()
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
    rig = Rig(bench, stale_timeout=60.0).drive()
    rig.node._run.lose('no new tracks for 0.51 s')
    rig.node._run.time_out(5.0)
    reason = last(bench, heard, 'failed')['reason']
    assert reason.startswith('tracks lost or untrusted for 5 s: ')
    assert heard[-1].status[0].level == b'\x02'
    assert heard[-1].status[0].message == f'failed: {reason}'


def test_who_stops_a_run_is_told_of(bench) -> None:
    heard = results(bench)
    press = bench.talk(Bool, 'stop_button', qos.LATCHED)
    Rig(bench, stale_timeout=60.0).drive()
    press(Bool(data=True))
    said = last(bench, heard, 'stopped')
    assert said['reason'] == 'the stop button is pressed'
    assert said['elapsed_s'] != 'nan'  # of the run that was stopped
    assert heard[-1].status[0].level == b'\x01'


def test_a_hold_is_no_result(bench) -> None:
    heard = results(bench)
    rig = Rig(bench, stale_timeout=60.0).drive()
    rig.tell(write.features(Features(goal=1), rig.stamp_ns, 'camera'))
    assert rig.phase == 'holding'
    for _ in range(4):
        rig.stamp_ns += 90_909_091
        rig.see()
    assert rig.node._state.phase.drives and rig.twists()[-1] != STANDSTILL
    assert [read.diagnosis(item)['outcome'] for item in heard] == ['running']
