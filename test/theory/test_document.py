"""docs/theory.md: what it links exists, and each equation is named where it is computed."""

from pathlib import Path
import re

from loaded import DOCS, linked, loaded
import pytest

PAGE = DOCS / 'theory.md'
TEXT = PAGE.read_text(encoding='utf-8')
CODE = re.findall(r'\[`([\w.]+)`\]\(([^)]+)\)', TEXT)
LINKS = re.findall(r'\]\(([^)]+)\)', TEXT)
# Rows of the table: equations (or sections), name in the code, its file, the file of its test.
ROWS = re.findall(r'^\| (.+?) \| \[`([\w.]+)`\]\((.+?)\) \| \[test\]\((.+?)\) \|$', TEXT, re.M)


@pytest.mark.parametrize(('name', 'path'), sorted(set(CODE)))
def test_what_is_named_is_in_the_code(name: str, path: str) -> None:
    assert name.partition('.')[0] == Path(path).stem
    assert linked(name, path).__doc__


@pytest.mark.parametrize(('equations', 'name', 'path', 'test'), ROWS)
def test_an_equation_is_named_where_it_is_computed_and_held(equations, name, path, test) -> None:
    text = linked(name, path).__doc__
    for equation in equations.split(', '):
        number = equation.strip('()')
        assert re.search(rf'(?<![\w.]){re.escape(number)}(?![\w.]*\d)', text), (
            f'the docstring of {name} does not name eq. {equation}'
        )
    function = name.split('.')[-1]
    assert function in (DOCS / test).read_text(encoding='utf-8')


def test_every_equation_of_the_paper_has_its_row() -> None:
    numbers = [int(n) for row in ROWS for n in re.findall(r'\((\d+)\)', row[0])]
    assert sorted(numbers) == list(range(1, 31))


def test_every_figure_of_the_page_is_drawn_with_units_on_its_axes() -> None:
    module = loaded(DOCS / 'theory_figures.py')
    assert set(module.FIGURES) == {link for link in LINKS if link.endswith('.png')}
    for draw in module.FIGURES.values():
        for axes in draw().axes:
            assert axes.get_xlabel()
            assert axes.get_ylabel()
            assert axes.get_lines() or axes.collections
