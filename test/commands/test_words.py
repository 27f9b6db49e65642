"""Words for users: no markup of docstrings, names that are meant, gains that can be used."""

import ast
import json
from pathlib import Path

import pytest

from visual_servo_epipolar.commands.main import EVALUATION, main, parser
from visual_servo_epipolar.core.settings import names_of, range_of, Settings
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings, TrackerNodeSettings
from visual_servo_epipolar.simulation.scenario import CONNECTION, load

PACKAGE = Path(__file__).parents[2] / 'visual_servo_epipolar'
COMMANDS = next(item for item in parser(EVALUATION)._actions if item.dest == 'command').choices


@pytest.mark.parametrize('name', COMMANDS)
def test_help_is_plain_text(name: str) -> None:
    text = COMMANDS[name].format_help()
    assert '`' not in text
    assert COMMANDS[name].description[0].isupper()


def docstrings(tree: ast.AST) -> set[ast.expr]:
    """Return the docstrings of a module, and of all that is in it."""
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    bodies = [node.body for node in ast.walk(tree) if isinstance(node, kinds)]
    return {body[0].value for body in bodies if body and isinstance(body[0], ast.Expr)}


def test_no_message_has_the_markup_of_docstrings() -> None:
    remover = PACKAGE / 'commands/main.py'
    for path in sorted(set(PACKAGE.rglob('*.py')) - {remover}):
        tree = ast.parse(path.read_text(encoding='utf-8'))
        for node in set(ast.walk(tree)) - docstrings(tree):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                assert '``' not in node.value, (path, node.value)


def kinds(kind: type[Settings] = Settings) -> set[type[Settings]]:
    return {kind}.union(*map(kinds, kind.__subclasses__()))


def test_descriptions_of_parameters_are_plain_text() -> None:
    for kind in kinds():
        for item in getattr(kind, '__dataclass_fields__', {}).values():
            if 'range' in item.metadata:
                assert '`' not in range_of(item).text, (kind, item.name)


def test_the_gains_are_driven_with_as_they_are_printed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(['gains', '--farthest', '5', '--rate', '30']) == 0
    lines = capsys.readouterr().out.partition('\n\n')[2]
    path = tmp_path / 'mine.yaml'
    path.write_text(f'run: {{max_duration: 60}}\n{lines}')
    assert '/**:' in lines
    assert load(path).servo.initial_distance == 5.0
    assert (
        main(['simulate', '--start', '1', '-3', '0', '--scenario', str(path), '--json', '-']) == 0
    )
    assert json.loads(capsys.readouterr().out)['outcome'] == 'arrived'


def test_scenarios_leave_out_what_tells_a_node_how_it_is_connected() -> None:
    kinds = (ServoNodeSettings, TrackerNodeSettings)
    assert CONNECTION == {'use_sim_time', *(name for kind in kinds for name in names_of(kind))}


def test_a_scenario_and_a_setting_without_its_section_are_answered_by_what_is_meant(
    capsys,
) -> None:
    assert main(['simulate', '--start', '1', '-3', '0', '--scenario', 'smal']) == 2
    assert 'did you mean small?' in capsys.readouterr().err
    assert main(['replay', 'no_bag', '--set', 'look_ahead=0.3']) == 2
    assert 'did you mean servo.look_ahead?' in capsys.readouterr().err
