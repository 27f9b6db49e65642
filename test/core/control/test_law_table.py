"""A law is data: rows of a table, departures added and left out, and rows of other packages."""

from dataclasses import fields, replace
import math
from pathlib import Path
import re

from hypothesis import given
from hypothesis import strategies as st
import pytest

from visual_servo_epipolar.core.control import law_table
from visual_servo_epipolar.core.control.law_table import (
    DEPARTURES,
    epipole_controls,
    law_options,
    LawOptions,
    LAWS,
    matching_control,
)
from visual_servo_epipolar.core.control.settings import ControlSettings
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.servo.settings import ServoSettings

PACKAGE = Path(law_table.__file__).parents[2]


def test_the_paper_departs_in_nothing_but_its_own_section_ix() -> None:
    paper = LAWS['paper']
    assert [name for name in DEPARTURES if getattr(paper, name)] == ['new_attempts']


def test_the_corrected_law_departs_in_the_sign_alone() -> None:
    assert LAWS['corrected'] == replace(LAWS['paper'], true_sigma=True)


def test_the_full_law_takes_every_departure() -> None:
    assert all(getattr(LAWS['full'], name) for name in DEPARTURES)


@given(st.sets(st.sampled_from(sorted(DEPARTURES))))
def test_leaving_all_of_some_departures_out_and_adding_them_again_is_the_law(names) -> None:
    out, back = (''.join(f'{sign}{name}' for name in sorted(names)) for sign in '-+')
    assert law_options(f'full{out}{back}') == LAWS['full']
    assert all(not getattr(law_options(f'full{out}'), name) for name in names)


@pytest.mark.parametrize('name', DEPARTURES)
def test_each_departure_can_be_left_out_by_a_setting_of_its_name(name: str) -> None:
    options = ServoSettings(**{name: False}).options
    assert options == law_options(f'full-{name}')
    assert ServoSettings(law=f'full-{name}').options == options


@pytest.mark.parametrize('name', DEPARTURES)
def test_no_setting_adds_a_departure_to_a_law_that_does_not_take_it(name: str) -> None:
    assert ServoSettings(law='paper', **{name: True}).options == LAWS['paper']


def test_every_departure_has_its_setting() -> None:
    settings = {item.name for item in fields(ServoSettings)}
    assert set(DEPARTURES) <= settings
    assert set(DEPARTURES) - {item.name for item in fields(ControlSettings)} == {
        'compensate_rotation'
    }


@pytest.mark.parametrize(
    ('law', 'message'),
    [
        ('fulll', r"law must be one of paper, corrected, full.*got 'fulll'"),
        ('full-sigma', r"law 'full-sigma' names no departure sigma; there are true_sigma, "),
        ('', 'law must be one of'),
        ('full-', 'names no departure'),
        ('-retreat', 'law must be one of'),
    ],
)
def test_an_unknown_law_or_departure_is_named(law: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        ServoSettings(law=law)


def test_a_law_of_ones_own_brings_its_controls() -> None:
    own = LawOptions(
        epipole_controls=lambda *_, **__: (1.0, 2.0),
        matching_control=lambda *_, k_t: Twist(k_t, 0),
    )
    assert epipole_controls(own, finite_time=True)(0.1, 0.2) == (1.0, 2.0)
    assert matching_control(own)(0.1, k_t=3.0) == Twist(3.0, 0)


def test_the_paper_brings_its_own_controls() -> None:
    gains = {'k1': 0.1, 'k2': 0.2, 'exponent': 0.5}
    plain = epipole_controls(LAWS['paper'], finite_time=False)
    finite = epipole_controls(LAWS['paper'], finite_time=True)
    assert plain(0.25, 0.25, **gains) == (-0.025, -0.1)  # eq. (12)
    assert finite(0.25, 0.25, **gains) == (-0.05, -0.1)  # eq. (20)
    assert matching_control(LAWS['paper'])(0.1, k_t=2.0).linear == pytest.approx(-0.2)
    assert math.isclose(matching_control(LAWS['paper'])(0.1, k_t=2.0).angular, 0.0)


def test_no_module_compares_a_law_with_a_name() -> None:
    names = '|'.join(LAWS)
    comparison = re.compile(rf"(?<!for )\blaw\w*\s*(?:==|!=|in)\s*\(?['\"]({names})['\"]")
    guilty = [
        str(path.relative_to(PACKAGE))
        for path in PACKAGE.rglob('*.py')
        if comparison.search(path.read_text(encoding='utf-8'))
    ]
    assert guilty == []
