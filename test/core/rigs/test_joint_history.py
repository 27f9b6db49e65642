"""Joint history: angles at the time of an image, and why they are not known."""

import math

from hypothesis import given
import pytest
from strategies import floats

from visual_servo_epipolar.core.rigs.joint_history import JointHistory
from visual_servo_epipolar.core.rigs.rig import Joints

MS = 1_000_000


def history(*stamps_ms: int, rate: float = 2.0) -> JointHistory:
    """Return the history of a pan joint that turns at ``rate`` [rad/s]."""
    found = JointHistory(rate)
    for stamp in stamps_ms:
        assert found.add(stamp * MS, Joints(rate * stamp / 1000.0)) == ''
    return found


@given(milliseconds=floats(1000.0, 1180.0))
def test_between_readings_and_shortly_after_angles_go_on(milliseconds: float) -> None:
    joints = history(*range(1000, 1101, 20)).at(round(milliseconds * MS))
    assert joints is not None
    assert joints.pan == pytest.approx(2.0 * milliseconds / 1000.0, abs=1e-8)


def test_at_a_reading_it_is_that_to_the_last_bit() -> None:
    assert history(1000, 1037).at(1037 * MS) == Joints(2.0 * 1037 / 1000.0)


@pytest.mark.parametrize(
    ('stamps', 'image', 'words'),
    [
        ((), 1000, 'no joint angles yet'),
        ((1000, 1020), 1200, 'older than the image'),
        ((1000, 1020), 900, 'begin 0.10 s after the image'),
        ((1000, 1300), 1150, 'silent for 0.30 s'),
        (tuple(range(1000, 1620, 20)), 1050, '0.55 s newer than the image'),
    ],
)
def test_what_is_not_known_is_told(stamps: tuple[int, ...], image: int, words: str) -> None:
    found = history(*stamps, rate=0.1)
    assert found.at(image * MS) is None
    assert words in found.trouble(image * MS)


def test_a_clock_that_is_set_back_begins_it_anew() -> None:
    found = history(1000, 1020)
    assert 'went back' in found.add(500 * MS, Joints(-3.0))
    assert found.at(500 * MS) == Joints(-3.0)


@pytest.mark.parametrize('turn', [0.2, -3.0])
def test_after_a_leap_nothing_is_known_for_good(turn: float) -> None:
    found = history(1000, 1020)
    pan = 2.0 * 1.02 + turn
    assert 'leap by' in found.add(1040 * MS, Joints(pan))
    for stamp in range(1060, 2000, 20):
        assert found.add(stamp * MS, Joints(pan)) == ''
        assert found.at(stamp * MS) is None and 'call ~/reset' in found.trouble(stamp * MS)


def test_twice_the_speed_of_the_head_is_no_leap() -> None:
    found = history(1000, 1020)
    assert found.add(1070 * MS, Joints(2.0 * 1.02 + 0.2)) == ''


def test_angles_that_are_no_numbers_are_refused() -> None:
    assert 'finite' in history(1000).add(1020 * MS, Joints(math.nan))
