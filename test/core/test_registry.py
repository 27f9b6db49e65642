"""Named variants, our own and those of other packages: found, checked, named where broken."""

from importlib.metadata import EntryPoint
from typing import Any

import pytest

from visual_servo_epipolar.core import registry
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
