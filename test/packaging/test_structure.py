"""Sizes that a reader can take in, names that mean one thing; exceptions are listed here."""

import ast
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / 'visual_servo_epipolar'
MOST_LINES, MOST_FIELDS = 40, 12
# These lists only become shorter. Functions: so many lines at most.
LONG_FUNCTIONS: dict[str, int] = {}
# Settings are flat, for ROS has them flat, and so are the members of an enumeration.
LARGE_VALUES = {
    'Departures',
    'Event',
    'GoalEstimate',
    'Inspection',
    'Kind',
    'MapLocalization',
    'Measurement',
    'Phase',
    'Recording',
    'Task',
}
FLAT = ('Settings', 'Circumstances')
DOUBLE_NAMES = {'Gains', 'Scene'}
DOCUMENTED = {'_replace', '_exit'}  # of named tuples, and of os


@cache
def trees() -> list[tuple[str, ast.Module]]:
    """Return the files of the package, parsed."""
    return [
        (str(path.relative_to(PACKAGE)), ast.parse(path.read_text(encoding='utf-8')))
        for path in sorted(PACKAGE.rglob('*.py'))
    ]


@cache
def nodes() -> list[tuple[str, ast.AST]]:
    """Return all classes and functions of the package, with the file that each is in."""
    return [
        (file, node)
        for file, tree in trees()
        for node in statements_of(tree)
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef))
    ]


def statements_of(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the statements below ``node``: expressions, most of a tree, hold none."""
    for name in ('body', 'orelse', 'finalbody', 'handlers', 'cases'):
        for child in getattr(node, name, ()):
            yield child
            yield from statements_of(child)


def lines_of(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return how many lines a function has, without its docstring."""
    text = node.body[0] if ast.get_docstring(node) else None
    lines = (node.end_lineno or 0) - node.lineno + 1
    return lines - ((text.end_lineno or 0) - text.lineno + 1 if text else 0)


def test_a_function_has_at_most_40_lines() -> None:
    long = [
        (file, node.name, lines_of(node))
        for file, node in nodes()
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
        and lines_of(node) > LONG_FUNCTIONS.get(node.name, MOST_LINES)
    ]
    assert not long


def test_a_value_has_at_most_twelve_fields() -> None:
    large = [
        (file, node.name)
        for file, node in nodes()
        if isinstance(node, ast.ClassDef)
        and any('dataclass' in ast.unparse(item) for item in node.decorator_list)
        and sum(isinstance(item, ast.AnnAssign) for item in node.body) > MOST_FIELDS
        and node.name not in LARGE_VALUES
        and not node.name.endswith(FLAT)
    ]
    assert not large


def test_a_class_name_occurs_once() -> None:
    names = Counter(
        node.name
        for _, node in nodes()
        if isinstance(node, ast.ClassDef) and not node.name.startswith('_')
    )
    assert {name for name, count in names.items() if count > 1} <= DOUBLE_NAMES


# Lines that the module of a node reaches, with all that it imports; they only become fewer.
MOST_REACHED = {'tracker_node': 11_500, 'unicycle_node': 6_500, 'servo_node': 25_500}


def imported(path: Path) -> set[Path]:
    """Return the modules of the package that a module imports, also for types alone."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.ImportFrom) and (node.module or '').startswith(PACKAGE.name):
            module = PACKAGE.parent / (node.module or '').replace('.', '/')
            for place in (module, *(module / item.name for item in node.names)):
                if place.with_suffix('.py').is_file():
                    found.add(place.with_suffix('.py'))
    return found


def test_no_modules_import_each_other_for_types_neither() -> None:
    left = {path: imported(path) - {path} for path in PACKAGE.rglob('*.py')}
    while free := {path for path, needed in left.items() if not needed & left.keys()}:
        left = {path: needed for path, needed in left.items() if path not in free}
    assert sorted(left) == []


@pytest.mark.parametrize('node', MOST_REACHED)
def test_a_node_reaches_no_more_than_it_needs(node: str) -> None:
    reached, left = set(), {PACKAGE / f'nodes/{node}.py'}
    while left:
        reached |= left
        left = {found for path in left for found in imported(path)} - reached
    lines = sum(len(path.read_text(encoding='utf-8').splitlines()) for path in reached)
    assert lines <= MOST_REACHED[node], sorted(str(path) for path in reached)


def test_no_private_part_of_a_dependency_is_used() -> None:
    own = own_names()
    found = {(file, name) for file, tree in trees() for name in foreign_names(tree)}
    assert not {each for each in found if is_private(each[1]) and each[1] not in own}


def is_private(name: str) -> bool:
    """Return whether a part of a name has an underscore before it, or is an implementation."""
    parts = name.split('.')
    return 'impl' in parts or any(it.startswith('_') and not it.endswith('__') for it in parts)


def foreign_names(tree: ast.Module) -> Iterator[str]:
    """Yield what is imported from other packages, attributes, and what ``getattr`` asks for."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.Import):
            yield from (item.name for item in node.names)
        elif isinstance(node, ast.ImportFrom) and not (node.module or '').startswith(PACKAGE.name):
            yield from (f'{node.module}.{item.name}' for item in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func) in ('getattr', 'setattr'):
            name = node.args[1]
            if isinstance(name, ast.Constant):
                yield str(name.value)


def own_names() -> set[str]:
    """Return the names that the package defines itself."""
    names = set(DOCUMENTED)
    for _, tree in trees():
        for node in ast.walk(tree):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
                names.add(node.name)
            elif isinstance(node, (ast.Name, ast.Attribute)) and isinstance(node.ctx, ast.Store):
                names.add(node.id if isinstance(node, ast.Name) else node.attr)
    return names
