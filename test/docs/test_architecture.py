"""The way of one feature, as docs/architecture.md tells it: as the imports have it, and short."""

import ast
from pathlib import Path
import re

import pytest

ROOT = Path(__file__).parents[2]
PAGE = ROOT / 'docs' / 'architecture.md'
ROWS = re.findall(r'^\| (\d+) \| \[`[\w.]+`\]\(\.\./([\w/.]+)\) \|', PAGE.read_text(), re.M)
WAY = [ROOT / path for _, path in ROWS]
LONGEST = 15
TOPIC = "'tracks'"
# Named by the registry, which the settings ask for an estimator.
THROUGH = {'estimators/soft_planar.py': 'estimators/registry.py'}


def imports(path: Path) -> set[Path]:
    """Return the files of the package that ``path`` imports by name."""
    files = set()
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.ImportFrom) and node.module:
            module = ROOT.joinpath(*node.module.split('.'))
            files |= {module.with_suffix('.py')}
            files |= {(module / name.name).with_suffix('.py') for name in node.names}
    return {file for file in files if file.is_file()}


def reaches(first: Path, other: Path) -> bool:
    """Whether ``first`` imports ``other``, directly or by the registry that names it."""
    named_by = next((by for file, by in THROUGH.items() if other.as_posix().endswith(file)), None)
    direct = imports(first)
    return other in direct or any(
        named_by is not None and file.as_posix().endswith(named_by) and other in imports(file)
        for file in direct
    )


def joined_by_a_topic(first: Path, other: Path) -> bool:
    """Whether both are nodes, and name the topic of the features."""
    nodes = (file for file in (first, other) if file.parts[-2] == 'nodes')
    return sum(TOPIC in file.read_text(encoding='utf-8') for file in nodes) == 2


def test_the_way_has_its_files_and_no_more_than_one_sits_down_to_read() -> None:
    assert [int(number) for number, _ in ROWS] == list(range(1, len(ROWS) + 1))
    assert 10 <= len(WAY) <= LONGEST
    assert all(path.is_file() for path in WAY)


@pytest.mark.parametrize('place', range(1, len(WAY)))
def test_each_file_calls_or_is_called_by_one_above_it(place: int) -> None:
    path, above = WAY[place], WAY[:place]
    assert any(
        reaches(other, path) or reaches(path, other) or joined_by_a_topic(other, path)
        for other in above
    ), path


def test_the_way_leads_from_an_image_to_a_twist() -> None:
    assert 'Image' in WAY[0].read_text(encoding='utf-8')
    assert 'Twist' in WAY[-1].read_text(encoding='utf-8')


def test_what_the_servo_calls_between_tracks_and_twist_is_on_the_way() -> None:
    # Whoever hands the measurement on must be listed; settings, state and table are data.
    step = next(path for path in WAY if path.name == 'step.py')
    listed = {path for path in WAY if path.parts[-2] in ('servo', 'phases', 'perception')}
    called = {
        path
        for path in imports(step)
        if path.parts[-2] in ('servo', 'phases')
        and path.name not in ('settings.py', 'state.py', 'table.py')
    }
    assert called <= listed
