"""Faults of real processes: signals reach them whatever this process ignores."""

import signal

import pytest

from visual_servo_epipolar.evaluation.faults import processes as runs
from visual_servo_epipolar.evaluation.faults.processes import PROCESSES


@pytest.mark.long
@pytest.mark.alone
def test_a_servo_whose_terminal_is_closed_leaves_the_robot_at_rest_under_nohup_too() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup has it
    try:
        result = runs.run('process_hangup_servo', PROCESSES['process_hangup_servo'], 0)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
    assert result['verdict'] == 'at rest', result['charges']
    assert result['phase'] == 'waiting'


@pytest.mark.alone
def test_a_servo_that_is_suspended_leaves_the_robot_at_rest() -> None:
    """The base does not stop by itself here: the servo must, before it sleeps."""
    result = runs.run('process_suspend_servo', PROCESSES['process_suspend_servo'], 0)
    assert result['verdict'] == 'at rest', result['charges']
