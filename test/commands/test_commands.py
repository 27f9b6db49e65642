"""The command line as its users meet it: JSON, exit codes, one clear line when it cannot."""

import ast
import json
from pathlib import Path
import subprocess

from command_line import COMMAND, document, environment, refusal, ROOT, TINY
import cv2
import pytest

from visual_servo_epipolar.commands.main import EVALUATION, main, parser
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import names_of, range_of, Settings
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings, TrackerNodeSettings
from visual_servo_epipolar.simulation.scenario import CONNECTION, load

KEYS = {
    *('outcome', 'reason', 'start', 'seed', 'position_error_m', 'lateral_error_m'),
    *('longitudinal_error_m', 'heading_error_deg', 'duration_s', 'path_length_m'),
    *('max_distance_ratio', 'min_visible_features', 'max_linear_speed', 'max_angular_speed'),
    *('phases', 'attempts', 'wrong_geometry_s'),
}
CLOSE = ('--start', '0.3', '-2.2', '0')
START = ('--start', '1', '-3', '0')
PACKAGE = ROOT / 'visual_servo_epipolar'
COMMANDS = parser(EVALUATION).commands


@pytest.fixture
def scenario(tmp_path) -> str:
    path = tmp_path / 'tiny.yaml'
    path.write_text(f'{TINY}run: {{max_duration: 2.0}}')
    return str(path)


def test_simulate_prints_a_summary_or_json_alone(tmp_path, capsys) -> None:
    path, words = tmp_path / 'result ä.json', ('simulate', *START, '--seed', '1', '--json')
    assert main([*words, str(path)]) == 0
    assert 'arrived after' in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == [path]
    ended = subprocess.run([*COMMAND, *words, '-'], env=environment(), capture_output=True)
    assert (ended.returncode, ended.stderr, ended.stdout) == (0, b'', path.read_bytes())
    result = json.loads(ended.stdout)
    assert result.keys() >= KEYS
    assert (result['outcome'], result['start'], result['seed']) == ('arrived', [1, -3, 0], 1)
    assert all(phase.keys() == {'name', 'start_s', 'end_s'} for phase in result['phases'])


def test_the_printed_sign_fails_with_a_reason_and_no_way_is_no_ratio(capsys) -> None:
    result = document(capsys, 'simulate', *START, '--law', 'paper', code=1)
    assert (result['outcome'], result['law']) == ('failed', 'paper')
    assert result['reason']
    result = document(capsys, 'simulate', '--start', '0', '0', '0')
    assert result['max_distance_ratio'] is None


SIMULATE = ('simulate', *START)
REFUSED = [
    ([], 'COMMAND'),
    (['fly'], 'invalid choice'),
    (['simulate'], 'required: --start'),
    (['simulate', '--start', '1', '-3'], 'expected 3 arguments'),
    *(
        (['simulate', '--start', *start.split()], reason)
        for start, reason in (
            ('a -3 0', "'a' is not a number"),
            ('1 nan 0', 'not finite'),
            ('1 -3 1e999', 'not finite'),
            ('1e9 1 1', 'within 100 m and the heading within 360 deg of the goal, got 1e+09'),
            ('1 -101 1', 'got 1 -101 1'),
            ('1 -3 -361', 'got 1 -3 -361'),
        )
    ),
    *(([*SIMULATE, '--seed', it], 'not a whole number') for it in ('-1', '1.5', '99999999999')),
    *(([*SIMULATE, '--scenario', it], 'no scenario file') for it in ('other', '', '/')),
    ([*SIMULATE, '--law', 'other'], 'law must be one of'),
    ([*SIMULATE, '--estimator', 'other'], 'estimator must be one of'),
    ([*SIMULATE, '--source', 'other'], 'invalid choice'),
    ([*SIMULATE, '--scenario', 'smal'], 'did you mean small?'),
    *(([*SIMULATE, '--json', it], 'result cannot be written') for it in ('', '.')),
    (['replay', 'no_bag', '--set', 'look_ahead=0.3'], 'did you mean servo.look_ahead?'),
]


@pytest.mark.parametrize(('arguments', 'reason'), REFUSED)
def test_bad_usage_is_one_line(capsys, arguments, reason) -> None:
    assert reason in refusal(capsys, *arguments)


def test_a_bad_scenario_is_refused(capsys, tmp_path) -> None:
    path = tmp_path / 'scenario.yaml'
    path.write_text('camera: {distortion: [0.1]}')
    error = refusal(capsys, 'simulate', *START, '--scenario', str(path))
    assert str(path) in error and 'distortion must be' in error


NEEDED = {
    'simulate': START,
    'sweep': ('--region', 'front', '--runs', '1'),
    'inspect': ('a', 'b', '--camera', 'c'),
    'replay': ('bag',),
    'report': ('bag',),
    'route': ('teach', 'bag'),
}


@pytest.mark.parametrize('option', ['--out', '--json', '--table'])
@pytest.mark.parametrize('name', COMMANDS)
def test_what_is_not_writable_is_refused_first(
    capsys, tmp_path, monkeypatch, name, option
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'file').touch()
    which = ('all',) if name == 'reproduce' else NEEDED.get(name, ())
    with pytest.raises(SystemExit):
        main([name, *which[: name == 'route'], '--help'])
    if f'{option} ' not in capsys.readouterr().out:
        return
    out = ('--out', 'o') if name == 'reproduce' and option != '--out' else ()
    error = refusal(capsys, name, *which, *out, option, 'file/x')
    assert error.startswith(f'visual_servo {name}: file/x: ') and 'Not a directory' in error
    assert [path.name for path in tmp_path.iterdir()] == ['file']


@pytest.mark.parametrize('option', ['', '=~/mine'])
@pytest.mark.parametrize(
    ('words', 'by_default', 'below'),
    [(['teach', 'bag'], 'bag_route', ''), (['demo'], 'route_out', 'route')],
)
def test_a_folder_is_no_place_for_a_route(
    capsys, tmp_path, monkeypatch, words, by_default, below, option
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('HOME', str(tmp_path))
    folder = tmp_path / ('mine' if option else by_default) / below
    folder.mkdir(parents=True)
    (folder / 'thesis.tex').touch()
    error = refusal(capsys, 'route', *words, *([f'--out{option}'] if option else []))
    assert 'holds something else, thesis.tex; name another one' in error


@pytest.mark.parametrize('name', COMMANDS)
def test_an_unknown_option_names_its_subcommand(capsys, name) -> None:
    needed = ('all', '--out', 'o') if name == 'reproduce' else NEEDED.get(name, ())
    error = refusal(capsys, name, *needed, '--colour')
    assert error == (
        f'visual_servo {name}: unrecognized arguments: --colour; see visual_servo {name} --help\n'
    )


def test_the_demo_equals_the_simulation_in_memory(tmp_path, capsys, scenario) -> None:
    pytest.importorskip('rclpy')
    pytest.importorskip('matplotlib')
    common = (*CLOSE, '--scenario', scenario, '--seed', '4')
    demo = document(capsys, 'demo', '--out', str(tmp_path / 'out'), *common, code=1)
    assert demo == document(capsys, 'simulate', '--source', 'images', *common, code=1)
    assert json.loads((tmp_path / 'out' / 'result.json').read_text()) == demo
    assert 'not arrived within 2 s' in demo['reason']
    for name in ('trajectory.png', 'signals.png'):
        picture = cv2.imread(str(tmp_path / 'out' / name))
        assert picture is not None and picture.std() > 0.0, name
    video = cv2.VideoCapture(str(tmp_path / 'out' / 'video.mp4'))
    frames = 0
    while video.read()[0]:
        frames += 1
    video.release()
    assert frames >= 20  # two seconds at 11 Hz


def test_no_message_has_the_markup_of_docstrings() -> None:
    for path in sorted(PACKAGE.rglob('*.py')):
        nodes = list(ast.walk(ast.parse(path.read_text(encoding='utf-8'))))
        documented = (ast.Module, ast.ClassDef, ast.FunctionDef)
        heads = [node.body[0] for node in nodes if isinstance(node, documented) and node.body]
        docstrings = {head.value for head in heads if isinstance(head, ast.Expr)}
        for node in set(nodes) - docstrings:
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                assert '``' not in node.value, (path, node.value)


def kinds(kind: type[Settings] = Settings) -> set[type[Settings]]:
    return {kind}.union(*map(kinds, kind.__subclasses__()))


def test_help_and_descriptions_of_parameters_are_plain_text() -> None:
    for name, command in COMMANDS.items():
        assert '`' not in command.format_help(), name
        assert command.description[0].isupper(), name
    for kind in kinds():
        for item in getattr(kind, '__dataclass_fields__', {}).values():
            if 'range' in item.metadata:
                assert '`' not in range_of(item).text, (kind, item.name)


def test_the_gains_are_driven_with_as_they_are_printed(tmp_path, capsys) -> None:
    assert main(['gains', '--farthest', '5', '--rate', '30']) == 0
    lines = capsys.readouterr().out.partition('\n\n')[2]
    path = tmp_path / 'mine.yaml'
    path.write_text(f'run: {{max_duration: 60}}\n{lines}')
    assert '/**:' in lines
    assert load(path).servo.initial_distance == 5.0
    result = document(capsys, 'simulate', *START, '--scenario', str(path))
    assert result['outcome'] == 'arrived'


def test_scenarios_leave_out_the_connections_of_nodes() -> None:
    kinds = (ServoNodeSettings, TrackerNodeSettings)
    assert CONNECTION == {'use_sim_time', *(name for kind in kinds for name in names_of(kind))}


AWAY = ('--start', '0', '-3', '180', '--scenario')
REASON = 'no feature of the photograph is in view'


def failed(path: Path) -> None:
    result = json.loads(path.read_text(encoding='utf-8'))
    assert result['outcome'] == 'failed'
    assert result['reason'].startswith(REASON)
    assert 0.0 <= result['duration_s'] - ServoSettings.holding_timeout < 0.2
    assert [phase['name'] for phase in result['phases']] == ['waiting']


@pytest.mark.parametrize('source', ['features', pytest.param('images', marks=pytest.mark.long)])
def test_a_simulation_ends_with_the_reason(tmp_path: Path, source: str) -> None:
    path = tmp_path / 'result.json'
    assert main(['simulate', *AWAY, 'small', '--source', source, '--json', str(path)]) == 1
    failed(path)


def test_the_demo_ends_with_the_reason_and_leaves_nothing_of_before(tmp_path: Path) -> None:
    pytest.importorskip('rclpy')
    pytest.importorskip('matplotlib')
    (tmp_path / 'video.mp4').write_bytes(b'that of an earlier run')
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag/bag_0.mcap').touch()
    scenario = tmp_path / 'tiny.yaml'
    scenario.write_text(TINY)
    options = ('--no-video', '--bag', 'none', '--out', str(tmp_path))
    assert main(['demo', *AWAY, str(scenario), *options]) == 1
    failed(tmp_path / 'result.json')
    assert not (tmp_path / 'video.mp4').exists()
    assert not (tmp_path / 'bag').exists()
