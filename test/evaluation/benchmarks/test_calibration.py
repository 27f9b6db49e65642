"""The benchmark of wrong camera matrices: it drives, and judges by ground truth."""

import math

import pytest

from visual_servo_epipolar.evaluation.benchmarks import calibration

GOOD = {
    'outcome': 'arrived',
    'reason': 'matched',
    'position_error_m': 0.001,
    'heading_error_deg': -0.1,
    'duration_s': 30.0,
}


@pytest.mark.parametrize(
    'changes', [{'position_error_m': 0.06}, {'heading_error_deg': -2.5}, {'position_error_m': 1.0}]
)
def test_who_says_that_it_arrived_and_did_not_is_wrong(changes: dict[str, float]) -> None:
    scores = calibration.scores([GOOD, GOOD | changes])
    assert (scores['starts'], scores['arrived'], scores['wrong']) == (2, 2, 1)


def test_an_honest_failure_is_not_wrong_and_says_why() -> None:
    scores = calibration.scores([GOOD, GOOD | {'outcome': 'failed', 'reason': 'lost'}])
    assert (scores['arrived'], scores['wrong'], scores['reasons']) == (1, 0, ['lost'])
    assert scores['position_max_m'] == 0.001
    assert math.isnan(calibration.scores([GOOD | {'outcome': 'failed'}])['position_p95_m'])


@pytest.mark.long
def test_the_camera_matrix_is_found_out_where_believing_it_fails() -> None:
    document = calibration.run(seed=0, quick=True, say=lambda _: None)
    rows = {row['method']: row for row in document['rows']}
    assert rows['found out']['arrived'] == 2
    assert rows['found out']['position_max_m'] < 0.01
    assert rows['believed']['arrived'] < 2
    text = calibration.table(document)
    assert f'{"0.25":>9}      2/2' in text
    assert text.count('above the axle') == 3
