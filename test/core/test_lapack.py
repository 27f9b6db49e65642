"""LAPACK called past numpy's checks: the same numbers, and the same errors."""

import numpy as np
import pytest

from visual_servo_epipolar.core.lapack import inverse, solved


@pytest.mark.parametrize('size', [3, 5, 30])
@pytest.mark.parametrize('columns', [(), (7,)])
def test_solutions_are_those_of_numpy_to_the_last_bit(size: int, columns: tuple[int, ...]) -> None:
    rng = np.random.default_rng(size)
    matrix, right = rng.normal(size=(size, size)), rng.normal(size=(size, *columns))
    for one in (matrix, matrix.T, matrix + matrix.T):
        assert (solved(one, right) == np.linalg.solve(one, right)).all()
        assert (inverse(one) == np.linalg.inv(one)).all()


@pytest.mark.filterwarnings('ignore:invalid value')
def test_a_singular_matrix_is_refused_as_numpy_does() -> None:
    for right in (np.ones(3), np.ones((3, 2))):
        with pytest.raises(np.linalg.LinAlgError, match='Singular'):
            solved(np.zeros((3, 3)), right)
    with pytest.raises(np.linalg.LinAlgError, match='Singular'):
        inverse(np.zeros((3, 3)))


def test_what_is_no_number_stays_none() -> None:
    matrix = np.full((2, 2), np.nan)
    assert np.isnan(solved(matrix, np.ones(2))).all()
