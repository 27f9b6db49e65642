"""``visual_servo reproduce`` as its users meet it."""

import json

import cv2
import pytest

from visual_servo_epipolar.commands.main import main


def test_simulation_2_writes_figures_table_data_and_json(tmp_path, capsys) -> None:
    out, result = tmp_path / 'out', tmp_path / 'result.json'
    assert main(['reproduce', 'sim2', '--out', str(out), '--json', str(result)]) == 0
    assert {path.name for path in out.iterdir()} == {
        *('figure_14.png', 'figure_15.png', 'figures.json', 'table.md')
    }
    assert all(cv2.imread(str(path)).std() > 0.0 for path in out.glob('*.png'))
    assert set(json.loads((out / 'figures.json').read_text())) == {'figure_14', 'figure_15'}
    document = json.loads(result.read_text())['sim2']
    assert document['succeeded'] is True
    assert document['numbers']['course']['outcome'] == 'arrived'
    table = (out / 'table.md').read_text()
    assert all(f'| {s["place"]} |' in table for s in document['statements'])
    assert 'DISAGREES' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['sim3', '--out', 'x'], 'invalid choice'),
        (['sim1'], 'required: --out'),
        (['sim1', '--out', '/dev/null/x'], 'nothing can be written there'),
    ],
)
def test_bad_usage_is_one_line(capsys, arguments, reason) -> None:
    try:
        code = main(['reproduce', *arguments])
    except SystemExit as end:
        code = end.code
    shown = capsys.readouterr()
    assert (code, shown.out) == (2, '')
    assert reason in shown.err and len(shown.err.splitlines()) == 1
