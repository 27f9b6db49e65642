"""The page of a report: what it draws is the same, whenever it is drawn."""

import math

from matplotlib.figure import Figure

from visual_servo_epipolar.report.page import figure_html


def line_at(left: float) -> Figure:
    figure = Figure()
    figure.add_axes((left, 0.1, 0.8, 0.8)).plot([0.0, 1.0])
    return figure


def test_a_figure_is_the_same_where_its_layout_differs_in_the_last_digit() -> None:
    after = math.nextafter(0.1, 1.0)
    assert figure_html(line_at(0.1), 'a line') == figure_html(line_at(after), 'a line')


def test_a_figure_of_another_layout_is_another() -> None:
    assert figure_html(line_at(0.1), 'a line') != figure_html(line_at(0.15), 'a line')
