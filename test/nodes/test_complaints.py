"""A complaint is not repeated for a while, and does not hide another."""

from visual_servo_epipolar.nodes.complaints import Complaints


def test_a_complaint_hides_its_repetitions_and_no_other(bench) -> None:
    complain = Complaints(bench.probe, 60.0)
    for text in ('3 features, 12 needed', 'too dark', '7.5 features, 12 needed', 'too dark'):
        complain(text)
    bench.until(lambda: len(bench.logged('')) >= 2, 'the complaints')
    bench.settle()
    assert bench.logged('') == ['3 features, 12 needed', 'too dark']


def test_a_complaint_that_lasts_is_said_again(bench) -> None:
    complain = Complaints(bench.probe, 0.0)
    complain('too dark')
    complain('too dark')
    bench.until(lambda: len(bench.logged('too dark')) == 2, 'both complaints')
