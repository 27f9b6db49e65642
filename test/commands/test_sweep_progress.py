"""The line of progress counts what came, and reckons with what came in this session alone."""

from sweeps import result

from visual_servo_epipolar.commands.sweep import SweepProgress

FAILED = result(outcome='failed')


def test_it_counts_and_reckons() -> None:
    now = [100.0]
    progress = SweepProgress(100, [result()] * 40, clock=lambda: now[0])
    now[0] += 5.0
    progress.add([result(), FAILED] * 5)
    assert progress.line() == (
        f'[{"#" * 10}{"." * 10}] 50/100  45 arrived  5 failed  2 runs/s  0:25 left'
    )


def test_it_names_what_must_not_be_overlooked() -> None:
    progress = SweepProgress(3)
    progress.add([result(position_error_m=0.06), result(outcome='failed', traceback='x')])
    assert '1 arrived  1 failed  1 wrong  1 raised' in progress.line()


def test_it_does_not_guess_before_the_first_result() -> None:
    assert SweepProgress(3, [result()]).line().endswith('0 runs/s  ? left')


def test_hours_are_shown_as_such() -> None:
    now = [0.0]
    progress = SweepProgress(1000, clock=lambda: now[0])
    now[0] = 10.0
    progress.add([result()])
    assert progress.line().endswith('2:46:30 left')
