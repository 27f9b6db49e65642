"""A run in a file: it comes back to the last bit, and a damaged file is one clear error."""

import json

import numpy as np
import pytest

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.report.run_file import load_run, RunFile, save_run


def test_a_run_comes_back_to_the_last_bit(log, tmp_path) -> None:
    run = RunFile(log, {'servo': {'k1': 0.1, 'law': 'full'}}, {'numpy': '2.0'})
    save_run(run, tmp_path)
    loaded = load_run(tmp_path)
    assert repr(loaded) == repr(run)  # for nan is not equal to itself
    assert [path.name for path in tmp_path.iterdir()] == ['run.json']


def test_what_was_not_measured_is_null_not_nan(log, tmp_path) -> None:
    text = save_run(RunFile(log), tmp_path).read_text()
    assert 'NaN' not in text
    assert None in json.loads(text)['samples']['distance_estimate']


def test_no_file_is_said_so(tmp_path) -> None:
    with pytest.raises(InputError, match=r'run\.json: run cannot be read: No such file'):
        load_run(tmp_path)


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        ({'format': 2}, 'format must be 1, got 2'),
        ({'samples': {}}, 'it has no samples'),
        ({'samples': 3}, 'not a run'),
        ({'start': [1, 2]}, 'not enough values'),
        ({'start': 'abc'}, 'could not convert'),
        ({'settings': 3}, 'not a run'),
    ],
)
def test_another_document_is_refused(log, tmp_path, change, reason) -> None:
    path = save_run(RunFile(log), tmp_path)
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(InputError, match=reason):
        load_run(tmp_path)


def test_a_damaged_file_is_always_one_clear_error(log, tmp_path) -> None:
    data, rng, refused = save_run(RunFile(log), tmp_path).read_bytes(), np.random.default_rng(0), 0
    for _ in range(100):
        damaged = bytearray(data)
        damaged[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
        if rng.integers(2):
            del damaged[int(rng.integers(len(data))) :]
        (tmp_path / 'run.json').write_bytes(damaged)
        try:
            load_run(tmp_path)
        except InputError as error:
            refused += 1
            assert 'run.json: ' in str(error)
            assert '\n' not in str(error)
    assert refused > 50
