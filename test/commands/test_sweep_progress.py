"""The line of progress counts what came, and reckons with what came in this session alone."""

from sweeps import result

from visual_servo_epipolar.commands.sweep.progress import Tally

FAILED = result(outcome='failed')


def test_it_counts_and_reckons() -> None:
    now = [100.0]
    tally = Tally(100, [result()] * 40, clock=lambda: now[0])
    now[0] += 5.0
    tally.add([result(), FAILED] * 5)
    assert tally.line() == (
        f'[{"#" * 10}{"." * 10}] 50/100  45 arrived  5 failed  2 runs/s  0:25 left'
    )


def test_it_names_what_must_not_be_overlooked() -> None:
    tally = Tally(3)
    tally.add([result(position_error_m=0.06), result(outcome='failed', traceback='x')])
    assert '1 arrived  1 failed  1 wrong  1 raised' in tally.line()


def test_it_does_not_guess_before_the_first_result() -> None:
    assert Tally(3, [result()]).line().endswith('0 runs/s  ? left')


def test_hours_are_shown_as_such() -> None:
    now = [0.0]
    tally = Tally(1000, clock=lambda: now[0])
    now[0] = 10.0
    tally.add([result()])
    assert tally.line().endswith('2:46:30 left')
