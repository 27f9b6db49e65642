"""Helpers of arrays: what they return is the same wherever it lies in memory."""

import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import packed

ROWS = 50


@pytest.mark.parametrize('function', [np.arctan2, np.power])
def test_a_column_gives_the_same_bits_right_in_front_of_the_result(function: np.ufunc) -> None:
    room = np.random.default_rng(0).uniform(0.1, 1.0, 4 * ROWS)
    rows, behind = room[: 3 * ROWS].reshape(ROWS, 3), room[3 * ROWS :]
    away = function(rows[:, 0].copy(), rows[:, 2].copy())
    function(packed(rows[:, 0]), packed(rows[:, 2]), out=behind)
    np.testing.assert_array_equal(behind, away)


def test_nothing_else_is_changed() -> None:
    table = np.arange(12.0).reshape(4, 3)
    assert packed(table) is table
    assert packed(table[:, 1]).flags.c_contiguous
    assert packed(np.float64(3.0)).shape == ()
