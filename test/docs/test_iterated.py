"""The iterated scheme under perturbed models: the bound of each attempt, and where errors end."""

import math

from iterated import AttemptError, bound, errors, EXCURSION, fixed_point, Plant, PLANTS
import pytest

DISCRETE = 0.01  # size of an error that steps in time leave [m]
FIRST = AttemptError(0.1, -0.1)


@pytest.mark.parametrize('name', PLANTS)
def test_no_attempt_leaves_more_than_the_bound(name: str) -> None:
    plant = PLANTS[name]
    course = errors(plant, FIRST, 3)
    for before, after in zip(course, course[1:], strict=False):
        assert after.size <= bound(before.size, plant) + DISCRETE
    # What both epipoles feed back leaves nothing.
    exact = name in ('nominal', 'slip 5 %', 'focal length 10 % off')
    assert (bound(FIRST.size, plant) == 0.0) == exact


def test_unequal_wheels_contract_by_the_same_factor_each_time() -> None:
    sizes = [error.size for error in errors(PLANTS['wheel radii 5 %'], FIRST, 5)]
    factors = [after / before for before, after in zip(sizes[1:], sizes[2:], strict=False)]
    assert max(factors) < 0.6
    assert max(factors) - min(factors) < 0.03


def test_a_yaw_that_is_not_learnt_ends_at_a_fixed_point() -> None:
    # The way s = EXCURSION h leaves tan(yaw) s aside: h = sqrt of that at the end.
    plant = PLANTS['camera yaw 2 deg']
    last = errors(plant, FIRST, 5)[-1]
    assert last.size == pytest.approx(EXCURSION * math.tan(plant.yaw), rel=0.03)
    assert last.size <= fixed_point(plant)


def test_too_crooked_wheels_do_not_contract() -> None:
    crooked = Plant(curvature=1.2, backward=1.2)
    assert bound(0.1, crooked) > 0.1
    assert errors(crooked, AttemptError(0.01, 0.0), 1)[-1].size > 0.1
