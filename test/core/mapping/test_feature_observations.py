"""Sightings: views to begin with differ by more than a turn, in whatever order features stand."""

import numpy as np
import pytest

from visual_servo_epipolar.core.mapping.feature_observations import (
    differ_in_place,
    FeatureObservations,
)


def shuffled(view: FeatureObservations) -> FeatureObservations:
    order = np.random.default_rng(1).permutation(len(view))
    return FeatureObservations(
        view.ids[order], view.current[order], view.desired[order], view.noise[order]
    )


@pytest.mark.parametrize(('first', 'other', 'expected'), [(2, 2, False), (2, 9, True)])
def test_the_order_of_features_does_not_matter(drive, first, other, expected) -> None:
    last, now = drive.observations(first), drive.observations(other)
    assert differ_in_place(last, now) is expected
    assert differ_in_place(last, shuffled(now)) is expected
    assert differ_in_place(shuffled(last), now) is expected


def test_views_that_share_too_little_differ(drive) -> None:
    view = drive.observations(2)
    few = view.take(np.arange(len(view)) < 2)
    assert differ_in_place(few, few) is True
    assert differ_in_place(view, few) is True
