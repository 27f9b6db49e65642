"""A complaint is not repeated for a while, and does not hide another."""

import pytest

from visual_servo_epipolar.nodes.startup.complaints import Complaints, MOST


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


@pytest.mark.parametrize('number', ['nan', '-inf', '1e-300', '+4e38', '640x480'])
def test_numbers_that_are_none_make_no_other_complaint(bench, number) -> None:
    complain = Complaints(bench.probe, 60.0)
    complain('320x240' if 'x' in number else 'x is 2.5')
    complain(number if 'x' in number else f'x is {number}')
    assert len(complain._said_ns) == 1


def test_of_ever_new_complaints_few_are_remembered(bench) -> None:
    complain = Complaints(bench.probe, 60.0)
    for number in range(3 * MOST):
        complain('no such lens: ' + 'x' * number)
    assert len(complain._said_ns) == MOST
