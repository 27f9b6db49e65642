"""Parameter files: shared by nodes, in any namespace, and never passed over in silence."""

from pathlib import Path

from node_process import node_class
import pytest
import yaml

from visual_servo_epipolar.core.settings import parameters_of
from visual_servo_epipolar.nodes.startup.table import NODES, settings_of

CONFIG = Path(__file__).parents[2] / 'config'
ELSEWHERE = ('-r', '__ns:=/robot1', '-r', '__node:=dock')
WARNING = 'sets no parameter of'


def start(bench, name, *words):
    """Start a node as its command line would."""
    return bench.add(node_class(name)(context=bench.context, cli_args=['--ros-args', *words]))


def given(path, *more):
    return ('--params-file', str(path), *more)


def file(folder, **keys):
    """Write a parameter file; keys by name, values are parameters."""
    path = folder / 'given.yaml'
    path.write_text(yaml.safe_dump(keys))
    return path


def under(key, **values):
    return {key: {'ros__parameters': values}}


@pytest.mark.parametrize('name', NODES)
def test_the_files_of_the_package_hold_in_a_namespace(bench, tmp_path, monkeypatch, name) -> None:
    monkeypatch.chdir(tmp_path)  # the recorder begins a bag where it is started
    text = (CONFIG / f'{name}.yaml').read_text()
    changes = {
        'servo_node': ('max_linear: 0.4', 'max_linear: 0.1'),
        'tracker_node': ('max_features: 60', 'max_features: 61'),
        'camera_node': ('noise: 2.0', 'noise: 2.5'),
        'unicycle_node': ('max_linear: 1.0', 'max_linear: 0.1'),
        'recorder_node': ('min_free: 200.0', 'min_free: 0.0'),
        'dock_node': ('path_deviation: 0.01', 'path_deviation: 0.02'),
        'route_node': ('max_turn_rate: 1.0', 'max_turn_rate: 0.5'),
    }
    assert changes[name][0] in text
    (tmp_path / 'edited.yaml').write_text(text.replace(*changes[name]))
    node = start(bench, name, *given(tmp_path / 'edited.yaml'), *ELSEWHERE[:2])
    assert node.get_fully_qualified_name() == f'/robot1/{name}'
    parameter, value = changes[name][1].split(': ')
    assert node.get_parameter(parameter).value == yaml.safe_load(value)
    node.get_logger().info('after all warnings')
    bench.until(lambda: bench.logged('after all warnings'), 'the end of the log')
    assert not bench.logged(WARNING)


@pytest.mark.parametrize('path', sorted(CONFIG.glob('*.yaml')), ids=lambda path: path.stem)
def test_every_file_reaches_any_node_that_it_can_mean(path) -> None:
    # What would set another thing of the same name elsewhere names its node, in any namespace; so
    # does what is for nodes of others.
    own = {name: [f'/**/{name}'] for name in ('recorder_node', 'unicycle_node')}
    others = ['/**/twist_mux', '/**/collision_monitor']
    keys = {**own, 'small_computer': ['/**/tracker_node'], 'obstacles': others}
    assert list(yaml.safe_load(path.read_text())) == keys.get(path.stem, ['/**'])


@pytest.mark.parametrize(
    'keys',
    [
        {**under('servo_node', max_linear=0.1), **under('/tracker', window=9)},
        under('/**', window=9),
    ],
    ids=['not reached', 'of other nodes'],
)
def test_a_file_that_sets_nothing_is_warned_of(bench, tmp_path, keys) -> None:
    path = file(tmp_path, **keys)
    start(bench, 'servo_node', *given(path), *ELSEWHERE)
    expected = f'{path} sets no parameter of /robot1/dock: they are for other nodes; key them /**:'
    bench.until(lambda: bench.logged(expected), f'{expected}; heard {bench.logged(WARNING)}')


def test_a_file_of_the_node_is_its_own_also_with_names_alone_that_have_gone(
    bench, tmp_path
) -> None:
    path = file(tmp_path, **under('dock_node', camera_left_deviation=0.02))
    start(bench, 'dock_node', *given(path)).get_logger().info('after all warnings')
    bench.until(lambda: bench.logged('after all warnings'), 'the end of the log')
    assert not bench.logged(WARNING)


def test_a_file_that_sets_the_clock_alone_is_not_warned_of(bench, tmp_path) -> None:
    start(bench, 'servo_node', *given(file(tmp_path, **under('/**', use_sim_time=False))))
    start(bench, 'tracker_node', *given(file(tmp_path, **under('other', max_features=9))))
    bench.until(lambda: bench.logged('parameter of /tracker_node'), 'the second warning')
    assert not bench.logged('parameter of /servo_node')


@pytest.mark.parametrize('kind', ['servo_node', 'tracker_node', 'unicycle_node', 'camera_node'])
def test_a_file_may_hold_the_parameters_of_all_nodes(bench, tmp_path, kind) -> None:
    values = {'latency': 0.5, 'max_features': 90, 'wheel_ratio': 1.1, 'tilt': 0.1}
    node = start(bench, kind, *given(file(tmp_path, **under('/**', **values))))
    assert sum(node.has_parameter(name) for name in values) == 1


@pytest.mark.parametrize(
    ('kind', 'name', 'hint'),
    [
        ('servo_node', 'max_linaer', 'did you mean max_linear'),
        ('servo_node', 'max_featuers', 'did you mean max_features'),
        ('tracker_node', 'max_linaer', 'did you mean max_linear'),
        *((name, 'zzz', 'it knows ') for name in NODES),
    ],
)
def test_a_name_of_no_node_is_refused(bench, tmp_path, monkeypatch, kind, name, hint) -> None:
    monkeypatch.chdir(tmp_path)  # a recorder that started would begin a bag here
    path = file(tmp_path, **under('/**', **{name: 1.0}))
    with pytest.raises(ValueError, match=f'has no parameter {name}; {hint}'):
        start(bench, kind, *given(path))


def test_a_name_of_another_node_is_refused_on_the_command_line(bench, tmp_path) -> None:
    path = file(tmp_path, **under('/**', max_features=50, latency=0.2))
    for words in (('-p', 'max_features:=50'), given(path, '-p', 'max_features:=40')):
        with pytest.raises(ValueError, match='no parameter max_features; but tracker_node has'):
            start(bench, 'servo_node', *words)
    with pytest.raises(ValueError, match='no parameter max_features; but tracker_node has'):
        bench.start(node_class('servo_node'), max_features=50)


@pytest.mark.parametrize(
    ('kind', 'name', 'value'),
    [
        ('servo_node', 'look_ahead', 0.5),
        ('tracker_node', 'window', 31),
        ('camera_node', 'person', 0.5),
    ],
)
def test_what_belongs_to_an_experiment_is_of_programs(bench, tmp_path, kind, name, value) -> None:
    path = file(tmp_path, **under('/**', **{name: value}))
    for words in (('-p', f'{name}:={value}'), given(path)):
        with pytest.raises(ValueError, match=f'has no parameter {name} any more: .* replay --set'):
            start(bench, kind, *words)
    assert not bench.start(node_class(kind)).has_parameter(name)
    assert bench.start(node_class(kind), **{name: value}).get_parameter(name).value == value


def test_a_shared_file_may_give_another_node_what_is_internal_here(bench, tmp_path) -> None:
    path = file(tmp_path, **under('/**', min_features=20, odometry=True, gains='derived'))
    expected = 'gains, min_features, odometry: parameters of other nodes, the defaults hold here'
    route = start(bench, 'route_node', *given(path))
    bench.until(lambda: bench.logged(expected), expected)
    assert not route.has_parameter('odometry')
    assert start(bench, 'tracker_node', *given(path)).get_parameter('min_features').value == 20
    servo = start(bench, 'servo_node', *given(path))
    assert servo.get_parameter('odometry').value and not servo.has_parameter('min_features')
    with pytest.raises(ValueError, match='route_node has no parameter odometry; but servo_node'):
        start(bench, 'route_node', '-p', 'odometry:=true')


@pytest.mark.parametrize('node', [name for name in NODES if name != 'route_node'])
def test_a_file_of_an_earlier_version_is_taken(bench, tmp_path, monkeypatch, node) -> None:
    monkeypatch.chdir(tmp_path)  # the recorder begins a bag where it is started
    start(bench, node, *given(Path(__file__).parents[1] / f'earlier/config/{node}.yaml'))


ROBOT = yaml.safe_load((CONFIG / 'robot.yaml').read_text())['/**']['ros__parameters']
SERVO, TRACKER, DOCK = (
    {item.name: item for kind in settings_of(node) for item in parameters_of(kind)}
    for node in ('servo_node', 'tracker_node', 'dock_node')
)


@pytest.mark.parametrize(
    ('kind', 'known'), [('servo_node', SERVO), ('tracker_node', TRACKER), ('dock_node', DOCK)]
)
def test_a_real_robot_takes_its_file_in_a_namespace(bench, tmp_path, kind, known) -> None:
    text = (CONFIG / 'robot.yaml').read_text()
    edited = text.replace('max_linear: 0.2', 'max_linear: 0.125').replace("''", "'goal.png'")
    (tmp_path / 'robot.yaml').write_text(edited if kind == 'servo_node' else text)
    node = start(bench, kind, *given(tmp_path / 'robot.yaml'), *ELSEWHERE)
    expected = {**ROBOT, **({'max_linear': 0.125} if kind == 'servo_node' else {})}
    values = {name: node.get_parameter(name).value for name in expected if name in known}
    assert values == {name: value for name, value in expected.items() if name in known}
    assert len(values) > 1


def test_each_parameter_of_a_robot_has_one_meaning_and_says_when_to_change_it() -> None:
    assert (ROBOT['autostart'], ROBOT['camera_reliability']) == (False, 'auto')
    assert set(ROBOT) <= set(SERVO) | set(TRACKER)
    assert set(ROBOT) & set(SERVO) & set(TRACKER) == {'camera_reliability', 'cropped', 'rectified'}
    lines = (CONFIG / 'robot.yaml').read_text().splitlines()
    for name in ROBOT:
        assert any(line.strip().startswith(f'{name}:') and ' # ' in line for line in lines), name


def test_the_tracker_of_a_small_computer_takes_its_file_after_the_robots(bench) -> None:
    files = (*given(CONFIG / 'robot.yaml'), *given(CONFIG / 'small_computer.yaml'))
    node = start(bench, 'tracker_node', *files, '-r', '__ns:=/robot1')
    small = yaml.safe_load((CONFIG / 'small_computer.yaml').read_text())['/**/tracker_node']
    expected = {'camera_reliability': 'auto', **small['ros__parameters']}
    assert {name: node.get_parameter(name).value for name in expected} == expected
