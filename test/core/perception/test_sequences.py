"""Drives home by features of which some are wrong all the way: what is trusted, how good it is."""

from durations import few_of
import numpy as np
import pytest
from sequences import (
    driven,
    DRIVES,
    error_deg,
)

from visual_servo_epipolar.core.perception.settings import PerceptionSettings

SETTINGS = PerceptionSettings()


def frames(kind: str, drives: int = 5) -> tuple[np.ndarray, int]:
    """Return the errors of trusted bearings [deg], and the number of frames."""
    seen = [each for k in range(drives) for each in driven(DRIVES[kind], (3, k), SETTINGS)]
    errors = [error_deg(true, found.bearings) for true, found in seen if found.bearings]
    return np.array(errors), len(seen)


def test_features_on_look_alikes_are_dropped_by_their_depths() -> None:
    errors, count = frames('alike')
    assert len(errors) > 0.8 * count  # 0.5 where they vote against the others
    assert errors.max() < 2.0


@pytest.mark.parametrize('kind', few_of(['few', 'huddled', 'elsewhere', 'noisy'], keep=(0, 1)))
def test_few_features_or_wrong_ones_mislead_nobody(kind: str) -> None:
    errors, count = frames(kind, drives=3)
    assert len(errors) > 0.5 * count
    assert errors.max() < 10.0
    assert np.percentile(errors, 95) < 4.0


@pytest.mark.parametrize(
    ('kind', 'seed'), [('few', 18), ('elsewhere', 16), ('elsewhere', 6), ('noisy', 11)]
)
def test_a_match_with_which_none_other_agrees_makes_no_bearing_certain(
    kind: str, seed: int
) -> None:
    """
    An epipole came to lie on one wrong match, or between its images: 2.7 deg off, 0.1 said.

    By leverage and by depths errors are at most 2.8 deviations in 96 % of the frames; without the
    one 11 to 19 on three of these drives, without the other 5.8 on one.
    """
    seen = list(driven(DRIVES[kind], (7, seed), SETTINGS))
    normalised = [
        error_deg(true, found.bearings) / np.degrees(found.deviation)
        for true, found in seen
        if found.bearings
    ]
    assert len(normalised) > 0.7 * len(seen)
    assert np.percentile(normalised, 95) < 3.0
    assert max(normalised) < 4.5
