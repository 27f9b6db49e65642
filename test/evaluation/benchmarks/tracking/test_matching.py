"""The matching benchmark: pairs in two lights, judged by where the camera was."""

from visual_servo_epipolar.core.tracking.matchers.registry import matcher_of
from visual_servo_epipolar.evaluation.benchmarks.tracking.matching import (
    figures,
    MatchingPlan,
    measure,
    table,
)


def test_a_dim_lamp_does_not_hide_the_photograph() -> None:
    plan = MatchingPlan(rooms=(201,), views=1, lights=('lamp_right',), exposures=('fixed',))
    document = measure(plan, {'sift': matcher_of('sift')}, 0, lambda _: None)
    (row,) = document['rows']
    (pair,) = row['pairs']
    assert pair['mean_grey'] < 80.0  # 123 at noon
    assert pair['error_deg'] < 1.0
    assert figures(document) == {'sift lamp_right fixed not right': 0.0}
    assert 'lamp_right  fixed' in table(document)
