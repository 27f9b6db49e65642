"""The campaign of faults: what is refused."""

import pytest

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.evaluation.faults.campaign import plan


def test_a_law_that_there_is_not_is_refused_before_any_run() -> None:
    with pytest.raises(InputError, match='law must be one of'):
        plan(['none'], 1, 0, 'smoth')
