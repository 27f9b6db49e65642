"""Joint history: angles at the time of an image, and why they are not known."""

import math
import re

from hypothesis import given
import pytest
from strategies import floats

from visual_servo_epipolar.core.rigs.joint_history import BEYOND, HeadHistory, JointHistory
from visual_servo_epipolar.core.rigs.rig import Joints

MS = 1_000_000


def history(*stamps_ms: int, rate: float = 2.0) -> JointHistory:
    """Return the history of a pan joint that turns at ``rate`` [rad/s]."""
    found = JointHistory('pan', rate, (-1000.0, 1000.0))
    for stamp in stamps_ms:
        assert found.add(stamp * MS, rate * stamp / 1000.0) == ''
    return found


@given(milliseconds=floats(1000.0, 1180.0))
def test_between_readings_and_shortly_after_angles_go_on(milliseconds: float) -> None:
    angle = history(*range(1000, 1101, 20)).at(round(milliseconds * MS))
    assert angle == pytest.approx(2.0 * milliseconds / 1000.0, abs=1e-8)


def test_at_a_reading_it_is_that_to_the_last_bit() -> None:
    assert history(1000, 1037).at(1037 * MS) == 2.0 * 1037 / 1000.0


@pytest.mark.parametrize(
    ('stamps', 'image', 'words'),
    [
        ((), 1000, 'no angle of pan yet'),
        ((1000, 1020), 1200, 'older than the image'),
        ((1000, 1020), 900, 'begin 0.10 s after the image'),
        ((1000, 1300), 1150, 'silent for 0.30 s'),
        (tuple(range(1000, 1620, 20)), 1050, '0.55 s newer than the image'),
    ],
)
def test_what_is_not_known_is_told(stamps: tuple[int, ...], image: int, words: str) -> None:
    found = history(*stamps, rate=0.1)
    assert words in found.trouble(image * MS)


def test_a_clock_that_is_set_back_begins_it_anew() -> None:
    found = history(1000, 1020)
    assert 'went back' in found.add(500 * MS, -3.0)
    assert found.at(500 * MS) == -3.0


@pytest.mark.parametrize('turn', [0.2, -3.0])
def test_after_a_leap_nothing_is_known_for_good(turn: float) -> None:
    found = history(1000, 1020)
    pan = 2.0 * 1.02 + turn
    assert 'leap by' in found.add(1040 * MS, pan)
    for stamp in range(1060, 2000, 20):
        assert found.add(stamp * MS, pan) == ''
        assert 'call ~/reset' in found.trouble(stamp * MS)


def test_twice_the_speed_of_the_head_is_no_leap() -> None:
    found = history(1000, 1020)
    assert found.add(1070 * MS, 2.0 * 1.02 + 0.2) == ''


def test_angles_that_are_no_numbers_are_refused() -> None:
    assert 'finite' in history(1000).add(1020 * MS, math.nan)


@given(late=floats(-500.0, 100.0))
def test_joints_of_separate_messages_are_merged(late: float) -> None:
    head = HeadHistory(('pan', 'tilt'), 2.0, (-1.0, 1.0))
    image = 2000 * MS
    for stamp in range(1000, 2001, 100):
        assert head.add(stamp * MS, {'pan': 0.1}) == ''
    assert head.missing == ['tilt'] and head.trouble(image) == 'no angle of tilt yet'
    assert head.at(image) is None
    for stamp in range(1000, 2001, 100):
        assert head.add(stamp * MS - round(late * MS), {'tilt': 0.2, 'wheel': 9.0}) == ''
    assert head.at(image) == pytest.approx(Joints(0.1, 0.2))


def test_a_head_without_tilt_has_it_at_zero() -> None:
    head = HeadHistory(('pan', ''), 2.0, (-1.0, 1.0))
    head.add(1000 * MS, {'pan': 0.1})
    assert head.at(1000 * MS) == Joints(0.1, 0.0)


@pytest.mark.parametrize('silent', ['pan', 'tilt'])
def test_a_joint_that_stays_away_is_named(silent: str) -> None:
    head = HeadHistory(('pan', 'tilt'), 2.0, (-1.0, 1.0))
    for stamp in range(1000, 1401, 100):
        head.add(stamp * MS, {name: 0.0 for name in ('pan', 'tilt') if name != silent})
        if stamp <= 1200:
            head.add(stamp * MS, {silent: 0.0})
    assert f'angles of {silent} are 0.20 s older' in head.trouble(1400 * MS)
    assert head.at(1400 * MS) is None and head.at(1200 * MS) == Joints(0.0, 0.0)


@pytest.mark.parametrize(
    ('name', 'wrong', 'right'),
    [('pan', 45.0, 1.0), ('pan', 2045.0, -1.0 - BEYOND), ('tilt', 30.0, 1.2)],
)
def test_angles_beyond_the_range_are_asked_about_and_not_taken(name, wrong, right) -> None:
    head = HeadHistory(('pan', 'tilt'), 2.0, (-1.0, 1.0))
    asked = f'the angle of {name} must lie within .* got {wrong:g}: degrees, or ticks'
    assert re.search(asked, head.add(1000 * MS, {'pan': 0.0, 'tilt': 0.0, name: wrong}))
    assert re.search(asked, head.trouble()) and head.at(1000 * MS) is None
    assert head.add(1020 * MS, {'pan': 0.0, 'tilt': 0.0, name: right}) == ''
    assert head.at(1020 * MS) is not None


def test_angles_that_leap_out_of_the_range_are_not_known_before_a_reset() -> None:
    head = HeadHistory(('pan', ''), 2.0, (-1.0, 1.0))
    head.add(1000 * MS, {'pan': 0.0})
    assert 'leap by 2045.00 rad' in head.add(1020 * MS, {'pan': 2045.0})
    assert head.add(1040 * MS, {'pan': 0.0}) == ''
    assert head.at(1040 * MS) is None and 'call ~/reset' in head.trouble(1040 * MS)
