"""The benchmark of wrong camera matrices: it drives, and judges by ground truth."""

import pytest

from visual_servo_epipolar.evaluation.benchmarks import calibration


@pytest.mark.long
def test_the_camera_matrix_is_found_out_where_believing_it_fails() -> None:
    document = calibration.run(seed=0, quick=True, say=lambda _: None)
    rows = {row['method']: row for row in document['rows']}
    assert rows['found out']['arrived'] == len(rows['found out']['runs']) == 2
    assert rows['found out']['position_error_m']['max'] < 0.01
    assert rows['believed']['arrived'] < 2
    text = calibration.table(document)
    assert text.count('above the axle') == text.count('0.25') == 2
