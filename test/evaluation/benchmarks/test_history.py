"""The history of benchmarks: what got worse is said, on one machine only."""

import pytest

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.evaluation.benchmarks import history


def entry(commit: str, machine: str = 'a', **figures: float) -> dict:
    return {
        'date': '2026-01-01',
        'commit': commit,
        'machine': machine,
        'figures': {'render': figures},
    }


def test_what_is_written_is_read(tmp_path) -> None:
    path = tmp_path / 'history.jsonl'
    assert history.read(path) == []
    entries = [history.entry({'render': {'ratio': 2.0}}), history.entry({})]
    for item in entries:
        history.append(path, item)
    assert history.read(path) == entries
    assert 'cores' in entries[0]['machine']


def test_each_figure_is_compared_with_its_last_value_on_this_machine() -> None:
    entries = [entry('old', ratio=1.0, drops=0.0), entry('new', drops=0.0), entry('b', 'b', x=1.0)]
    text = history.comparison(entries, entry('now', ratio=1.16, drops=1.0, x=5.0)).splitlines()
    by_name = {line.split()[1]: line for line in text[1:-1]}
    assert by_name['ratio'].endswith('1.16  old  WORSE')
    assert by_name['drops'].endswith('-  new  WORSE')
    assert by_name['x'].endswith('new')  # another machine's is none
    assert text[-1] == '2 figures got worse by more than 15%'
    assert 'WORSE' not in history.comparison(entries, entry('now', ratio=1.14, drops=0.0))


@pytest.mark.parametrize('line', ['[]', '{', '{"date": "2026-01-01"}'])
def test_another_file_is_refused_and_left_alone(tmp_path, line: str) -> None:
    path = tmp_path / 'notes.txt'
    path.write_text(f'{line}\n')
    with pytest.raises(InputError, match='line 1: not an entry of a history of benchmarks'):
        history.read(path)
    assert main(['bench', 'laws', '--quick', '--history', str(path)]) == 2
    assert path.read_text() == f'{line}\n'


def test_a_history_that_cannot_be_written_is_said_before_anything_runs(tmp_path, capsys) -> None:
    assert main(['bench', 'laws', '--history', str(tmp_path)]) == 2
    assert 'this is not the name of a file' in capsys.readouterr().err


@pytest.mark.parametrize('content', [b'\xff\xfe\n', None])
def test_what_is_no_file_of_text_is_one_line(tmp_path, capsys, content) -> None:
    path = tmp_path / 'history.jsonl'
    if content is not None:
        path.write_bytes(content)
    name = '-' if content is None else str(path)
    assert main(['bench', 'laws', '--quick', '--history', name]) == 2
    said = capsys.readouterr().err
    assert ('needs the name of a file' if content is None else 'history cannot be read') in said
    assert said.count('\n') == 1
