"""A law is data: rows of a table, departures left out, and rows of other packages."""

import ast
from collections.abc import Iterator
from dataclasses import fields, replace
from importlib.metadata import EntryPoint
from pathlib import Path
import pickle
import re

from hypothesis import given
from hypothesis import strategies as st
import pytest
from servo_states import BEARINGS, in_phase

from visual_servo_epipolar.core import registry
from visual_servo_epipolar.core.estimate.settings import DEPARTURES
from visual_servo_epipolar.core.laws import equations
from visual_servo_epipolar.core.laws import registry as law_registry
from visual_servo_epipolar.core.laws.machine import Law
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.laws.registry import LAWS
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.supervisor import nominal_twist
from visual_servo_epipolar.core.settings import range_of

PACKAGE = Path(law_registry.__file__).parents[2]
GROUP = 'visual_servo_epipolar.laws'
NAMES = frozenset(LAWS)  # to list them looks into every package that is installed
# Laws of another package, which brings them by entry points that name this module.
MY_LAW = replace(LAWS['paper'], epipole_controls=lambda *_, **__: (1.0, 2.0))
MY_LAW_PLUS = replace(LAWS['full'], true_sigma=False)


@pytest.fixture()
def foreign(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    names = {'my': 'MY_LAW', 'my-law': 'MY_LAW', 'my-law+': 'MY_LAW_PLUS'}
    points = [EntryPoint(name, f'{__name__}:{law}', GROUP) for name, law in names.items()]
    monkeypatch.setattr(registry, 'entry_points', lambda group: points)
    monkeypatch.setattr(LAWS, '_loaded', {})
    return


def test_each_law_departs_from_the_paper_in_what_it_says() -> None:
    paper = LAWS['paper']
    assert [name for name in DEPARTURES if getattr(paper, name)] == ['new_attempts']
    assert LAWS['corrected'] == replace(paper, true_sigma=True)
    assert all(getattr(LAWS['full'], name) for name in DEPARTURES)


@given(st.sampled_from(list(LAWS)), st.sets(st.sampled_from(sorted(DEPARTURES))))
def test_each_departure_can_be_left_out_by_a_setting_of_its_name(law: str, out: set[str]) -> None:
    left_out = dict.fromkeys(out, False)
    assert ServoSettings(law=law, **left_out).options == replace(LAWS[law], **left_out)


@pytest.mark.parametrize('name', DEPARTURES)
def test_no_setting_adds_a_departure_to_a_law_that_does_not_take_it(name: str) -> None:
    assert ServoSettings(law='paper', **{name: True}).options == LAWS['paper']


@pytest.mark.parametrize('name', DEPARTURES)
def test_a_setting_tells_of_its_departure_in_the_words_of_the_table(name: str) -> None:
    (item,) = (item for item in fields(ServoSettings) if item.name == name)
    assert range_of(item).text == f'Whether laws may {DEPARTURES[name]}'


@pytest.mark.parametrize(('law', 'row'), [('my', MY_LAW), ('my-law+', MY_LAW_PLUS)])
def test_a_law_of_another_package_may_have_any_name(foreign, law: str, row: Law) -> None:
    assert ServoSettings(law=law, final_turn=False).options == replace(row, final_turn=False)


def test_settings_pickle_whatever_functions_their_law_holds(foreign: None) -> None:
    settings = ServoSettings(law='my-law', retreat=False)
    options = settings.options  # kept from here on, with the lambda of the law in it
    back = pickle.loads(pickle.dumps(settings))
    assert back == settings
    assert back.options == options


@pytest.mark.parametrize('law', ['fulll', '', 'full-retreat', 'my-law+retreat'])
def test_an_unknown_law_is_named_with_all_that_there_are(foreign, law: str) -> None:
    message = rf"law must be one of paper, .*, my, my-law, my-law[+], got '{re.escape(law)}'"
    with pytest.raises(ValueError, match=message + '; a departure is left out by its setting'):
        ServoSettings(law=law)


def test_a_law_of_ones_own_brings_its_controls(foreign) -> None:
    settings = ServoSettings(law='my')
    e_au, e_du = BEARINGS.epipole_current, BEARINGS.epipole_desired
    asked = equations.linearizing_control(
        e_au, e_du, sigma=equations.printed_sigma(e_au, e_du), distance=8.0, nu=(1.0, 2.0)
    )
    assert nominal_twist(in_phase(Phase.ZEROING_EPIPOLES), settings) == asked


def is_name(node: ast.AST) -> bool:
    """Whether an operand is the name of a law, or a choice of some that holds one."""
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        return any(map(is_name, node.elts))
    if isinstance(node, ast.Name | ast.Attribute):
        return (node.id if isinstance(node, ast.Name) else node.attr) == 'DEFAULT_LAW'
    return isinstance(node, ast.Constant) and node.value in NAMES


def operands(node: ast.AST) -> list[ast.expr]:
    """Return what a node compares, by an operator, a pattern or a method of text."""
    if isinstance(node, ast.Compare):
        return [node.left, *node.comparators]
    if isinstance(node, ast.MatchValue):
        return [node.value]
    methods = ('startswith', 'endswith', 'removeprefix', '__eq__')
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        return node.args if node.func.attr in methods else []
    return []


def comparisons(source: str) -> Iterator[int]:
    """Yield the lines that compare something with the name of a law."""
    for node in ast.walk(ast.parse(source)):
        compared = operands(node)
        if any(map(is_name, compared)):
            yield compared[0].lineno


@pytest.mark.parametrize(
    ('source', 'compares'),
    [
        ("'full' == law", True),
        ("name not in {'paper'}", True),
        ('registry.DEFAULT_LAW == law', True),
        ("law.startswith(('full', 'other'))", True),
        ("match law:\n    case 'other' | 'full':\n        pass", True),
        ("def drive(law='full', other=DEFAULT_LAW): pass", False),
        ("results['paper'] == results['full']", False),
        ("law == 'other'", False),
    ],
)
def test_a_comparison_with_a_name_is_found(source: str, compares: bool) -> None:
    assert bool(list(comparisons(source))) is compares


def test_no_module_compares_a_law_with_a_name() -> None:
    guilty = [
        f'{path.relative_to(PACKAGE)}:{line}'
        for path in PACKAGE.rglob('*.py')
        for line in comparisons(path.read_text(encoding='utf-8'))
    ]
    assert guilty == []
