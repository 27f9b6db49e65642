"""What stands at the root of the core: registries, reasons, arrays."""

from importlib.metadata import EntryPoint
import pickle
from string import Formatter
from typing import Any

import numpy as np
import pytest

from visual_servo_epipolar.core import registry
from visual_servo_epipolar.core.arrays import packed
from visual_servo_epipolar.core.reasons import Reason, reason_of
from visual_servo_epipolar.core.registry import Registry

GROUP = 'visual_servo_epipolar.tests'


@pytest.fixture()
def variants(monkeypatch: pytest.MonkeyPatch) -> Registry[float]:
    """Return two of our own, and what three lines in the setup of another package bring."""
    points = [
        EntryPoint('tau', 'math:tau', GROUP),
        EntryPoint('one', 'math:e', GROUP),
        EntryPoint('broken', 'math:no_such_thing', GROUP),
        EntryPoint('word', 'string:digits', GROUP),
    ]

    def entry_points(group: str) -> list[EntryPoint]:
        return points if group == GROUP else []

    monkeypatch.setattr(registry, 'entry_points', entry_points)
    return Registry(GROUP, {'one': 1.0, 'two': 2.0}, float)


def test_our_own_come_first_and_cannot_be_replaced(variants: Registry[float]) -> None:
    assert list(variants) == ['one', 'two', 'broken', 'tau', 'word']
    assert len(variants) == 5
    assert variants['one'] == 1.0
    assert 'tau' in variants and 'three' not in variants
    assert variants['tau'] == pytest.approx(6.283185307)
    with pytest.raises(KeyError):
        variants['three']


@pytest.mark.parametrize(
    ('name', 'message'),
    [
        (
            'broken',
            'broken of .* cannot be loaded from math:no_such_thing: .*; mend the entry point',
        ),
        ('word', 'word of .* must be a float, got string:digits, a str; mend the entry point'),
    ],
)
def test_a_broken_variant_is_named(variants: Registry[float], name: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        variants[name]


@pytest.mark.parametrize(
    ('code', 'reason'),
    [
        ('raise RuntimeError("no licence\\nask for one")', 'RuntimeError: no licence ask for one'),
        ('law = (', 'SyntaxError: .*'),
        ('law = lwa', "NameError: name 'lwa' is not defined"),
        ('{}["law"]', "KeyError: 'law'"),
        ('import no_such_module', 'ModuleNotFoundError: .*'),
    ],
    ids=['runtime', 'syntax', 'name', 'key', 'import'],
)
def test_what_foreign_modules_raise_is_a_line(
    code, reason, tmp_path, request, monkeypatch
) -> None:
    module = f'foreign_{request.node.callspec.id}'  # one that no other test has imported
    (tmp_path / f'{module}.py').write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    points = [EntryPoint('foreign', f'{module}:law', GROUP)]
    monkeypatch.setattr(registry, 'entry_points', lambda group: points)
    message = f'^foreign of {GROUP} cannot be loaded from {module}:law: {reason}; mend the entry'
    with pytest.raises(ValueError, match=message):
        Registry(GROUP, {}, float)['foreign']


def test_without_a_type_a_variant_must_be_callable(monkeypatch: pytest.MonkeyPatch) -> None:
    points: Any = [EntryPoint('digits', 'string:digits', GROUP)]
    monkeypatch.setattr(registry, 'entry_points', lambda group: points)
    with pytest.raises(ValueError, match='must be callable'):
        Registry(GROUP, {})['digits']


@pytest.mark.parametrize('reason', Reason)
def test_a_text_keeps_its_reason_in_another_process_and_reads_as_any_text(reason: Reason) -> None:
    values = [
        1.0 if spec else 'word'
        for _, name, spec, _ in Formatter().parse(reason.value)
        if name is not None
    ]
    text = pickle.loads(pickle.dumps(reason.of(*values)))
    assert reason_of(text) is reason
    assert text == reason.value.format(*values)


def test_a_text_from_elsewhere_is_another_reason_whatever_its_words() -> None:
    assert reason_of(Reason.TILTED.value) is Reason.OTHER
    assert reason_of('') is Reason.NONE


ROWS = 50


@pytest.mark.parametrize('function', [np.arctan2, np.power])
def test_a_column_gives_the_same_bits_right_in_front_of_the_result(function: np.ufunc) -> None:
    room = np.random.default_rng(0).uniform(0.1, 1.0, 4 * ROWS)
    rows, behind = room[: 3 * ROWS].reshape(ROWS, 3), room[3 * ROWS :]
    away = function(rows[:, 0].copy(), rows[:, 2].copy())
    function(packed(rows[:, 0]), packed(rows[:, 2]), out=behind)
    np.testing.assert_array_equal(behind, away)


def test_nothing_else_is_changed() -> None:
    table = np.arange(12.0).reshape(4, 3)
    assert packed(table) is table
    assert packed(table[:, 1]).flags.c_contiguous
    assert packed(np.float64(3.0)).shape == ()
