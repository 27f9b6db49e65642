"""Golden runs that are kept: `make golden BASE=...` compares every bit of these and others."""

import json

import golden
import pytest

KEPT = json.loads(golden.KEPT.read_text(encoding='utf-8'))


@pytest.mark.parametrize('name', golden.SMALL)
def test_a_golden_run_goes_as_it_was_kept(name: str) -> None:
    found, kept = golden.summary(golden.RUNS[name]()), KEPT[name]
    assert (found['outcome'], found['phases']) == (kept['outcome'], kept['phases'])
    # Other processors round otherwise, and noise makes a millimetre of it.
    assert found['pose'] == pytest.approx(kept['pose'], abs=1e-3)


def test_the_first_step_and_field_that_differ_are_named() -> None:
    one = [{'x': 0.1, 'phase': 'waiting'}, {'x': float('nan'), 'phase': 'failed'}]
    other = [one[0], {**one[1], 'phase': 'holding'}]
    assert golden.difference(one, one) == ''
    assert golden.difference(one, other) == "step 1, phase: 'failed' -> 'holding'"
    assert golden.difference(one, one[:1]) == 'step 1, x: nan -> None'
