"""Work beside what makes it: in order, bounded, and its errors are not lost."""

import threading
import time

import pytest

from visual_servo_epipolar.report.images.background import background, WAITING


def test_calls_run_in_order_on_another_thread() -> None:
    done: list[tuple[int, bool]] = []
    here = threading.get_ident()
    with background() as do:
        for number in range(5 * WAITING):
            do(lambda n: done.append((n, threading.get_ident() != here)), number)
    assert done == [(number, True) for number in range(5 * WAITING)]


def test_no_more_than_some_calls_wait() -> None:
    gate, begun = threading.Event(), []
    submitted = 0

    def wait(number: int) -> None:
        begun.append(number)
        assert gate.wait(30.0), 'waited 30 s in vain for the gate'

    def feed() -> None:
        nonlocal submitted
        for number in range(WAITING + 3):
            do(wait, number)
            submitted += 1

    with background() as do:
        feeder = threading.Thread(target=feed)
        feeder.start()
        deadline = time.monotonic() + 30.0
        while submitted < WAITING:
            assert time.monotonic() < deadline, 'waited 30 s in vain for calls to be taken'
        feeder.join(0.1)
        assert feeder.is_alive() and submitted == WAITING
        gate.set()
        feeder.join(30.0)
    assert begun == list(range(WAITING + 3))


def test_an_error_comes_out_of_the_block() -> None:
    def fail() -> None:
        raise OSError('disk full')

    with pytest.raises(OSError, match='disk full'), background() as do:
        do(fail)


def test_an_error_comes_out_of_a_later_call() -> None:
    def fail() -> None:
        raise OSError('disk full')

    with pytest.raises(OSError, match='disk full'), background() as do:
        for _ in range(10 * WAITING):
            do(fail)
        pytest.fail('nobody said that the disk is full')


def test_after_an_exception_what_waits_is_left_out() -> None:
    gate, begun = threading.Event(), []

    def wait(number: int) -> None:
        begun.append(number)
        gate.wait(30.0)

    with pytest.raises(KeyboardInterrupt), background() as do:
        for number in range(WAITING):
            do(wait, number)
        threading.Timer(0.2, gate.set).start()
        raise KeyboardInterrupt
    assert len(begun) < WAITING
