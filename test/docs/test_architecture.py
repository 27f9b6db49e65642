"""The way of one feature, as docs/architecture.md tells it: as the imports have it, and short."""

import ast
from pathlib import Path
import re

from node_process import row_of
import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / 'docs' / 'architecture.md').read_text(encoding='utf-8')
ROWS = re.findall(r'^\| (\d+) \| \[`[\w.]+`\]\(\.\./([\w/.]+)\) \|', PAGE, re.M)
WAY = [ROOT / path for _, path in ROWS]
LEAF_TABLE = PAGE[PAGE.index('| leaves |') :].split('\n\n')[0]
LEAVES = [ROOT / path for path in re.findall(r'\]\(\.\./([\w/.]+)\)', LEAF_TABLE)]
ORDER = 'supervisor.py', 'perceive.py', 'validation.py', 'estimator.py'
OBSERVED, MOST_FROM_THERE = 'observation.py', 8
ORDERING = [path for path in WAY if path.name in ORDER]
LONGEST = 13
TOPIC = 'tracks'
# Named by the registry, which the settings ask for an estimator; rows of phases that laws share.
THROUGH = {
    'twoview/soft_planar.py': 'twoview/registry.py',
    'laws/two_steps.py': 'laws/standing.py',
}


def imports(path: Path) -> set[Path]:
    """Return the files of the package that ``path`` imports by name."""
    files: set[Path] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            files |= {ROOT.joinpath(*name.name.split('.')) for name in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            module = ROOT.joinpath(*node.module.split('.'))
            files |= {module, *(module / name.name for name in node.names)}
    return {file for file in (path.with_suffix('.py') for path in files) if file.is_file()}


def reaches(first: Path, other: Path) -> bool:
    """Whether ``first`` imports ``other``, directly or by the registry that names it."""
    named_by = next((by for file, by in THROUGH.items() if other.as_posix().endswith(file)), None)
    direct = imports(first)
    return other in direct or any(
        named_by is not None
        and file.as_posix().endswith(named_by)
        and (other in imports(file) or file in imports(other))
        for file in direct
    )


def test_the_way_has_its_files_and_is_short_enough_to_be_read() -> None:
    assert [int(number) for number, _ in ROWS] == list(range(1, len(ROWS) + 1))
    assert 10 <= len(WAY) <= LONGEST
    assert all(path.is_file() for path in WAY)
    observed = [path.name for path in WAY].index(OBSERVED)
    assert len(WAY) - observed <= MOST_FROM_THERE


@pytest.mark.parametrize('place', range(1, len(WAY)))
def test_each_file_calls_or_is_called_by_one_above_it(place: int) -> None:
    path, above = WAY[place], WAY[:place]
    assert any(
        reaches(other, path)
        or reaches(path, other)
        or TOPIC in row_of(other.stem)[1] & row_of(path.stem)[0]
        for other in above
    ), path


def test_the_way_begins_with_an_image_and_ends_with_a_twist() -> None:
    tracker, servo = (path for path in WAY if path.parts[-2] == 'nodes')
    assert tracker == WAY[0]
    assert 'image_raw' in row_of(tracker.stem)[0]
    assert 'cmd_vel' in row_of(servo.stem)[1]
    supervisor, laws = (path.read_text(encoding='utf-8') for path in (ORDERING[0], WAY[-1]))
    for text, name in (
        (supervisor, 'nominal_twist'),
        (laws, 'linearizing_control'),
        (laws, 'match_features'),
    ):
        assert re.search(rf'^def {name}\([^)]*\) -> Twist:', text, re.M), name


def test_what_the_four_files_import_that_order_the_others_is_on_the_way_or_a_leaf() -> None:
    # Whatever is new there: list it if it hands the row on, else name it among the leaves.
    assert tuple(path.name for path in ORDERING) == ORDER
    used = {file for path in ORDERING for file in imports(path)}
    leaves = {file for file in {*used, *WAY} if {file, *file.parents} & {*LEAVES}}
    assert used - {*WAY} == used & leaves
    unused = [leaf for leaf in LEAVES if not any(leaf in (file, *file.parents) for file in used)]
    assert unused == []
    assert leaves & {*WAY} == set()
