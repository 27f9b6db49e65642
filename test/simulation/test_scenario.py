"""Scenario files: what they set, and how bad ones are refused."""

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.stamps import period_ns
from visual_servo_epipolar.nodes.startup.table import accepted_names
from visual_servo_epipolar.simulation.bases import Pioneer
from visual_servo_epipolar.simulation.scenario import (
    CONNECTION,
    from_document,
    KINDS,
    load,
    NODES,
    Scenario,
)

SCENARIOS, RIGS = (
    sorted((Path(__file__).parents[2] / 'config' / kind).glob('*.yaml'))
    for kind in ('scenarios', 'rigs')
)


def written(folder: Path, text: str) -> Path:
    path = folder / 'bad.yaml'
    path.write_text(text, encoding='utf-8')
    return path


@pytest.mark.parametrize('text', ['', '# only a comment\n', '---\n', '{}', 'servo:\n'])
def test_an_empty_file_is_the_nominal_scenario(tmp_path: Path, text: str) -> None:
    assert load(written(tmp_path, text)) == Scenario()


def test_a_file_changes_what_it_names_and_nothing_else(tmp_path: Path) -> None:
    scenario = load(written(tmp_path, 'base:\n  slip: 0.1\nservo: {law: paper, k1: 1}\n'))
    assert (scenario.base.slip, scenario.servo.law, scenario.servo.k1) == (0.1, 'paper', 1.0)
    assert replace(scenario, base=Scenario().base, servo=Scenario().servo) == Scenario()


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('sevo: {k1: 1.0}', r'bad.yaml: no section sevo; did you mean servo\?'),
        ('world: {k1: 1.0}', 'bad.yaml: no section world; it knows run, base, camera'),
        ('servo: {k3: 1.0}', r'bad.yaml: servo has no setting k3; did you mean k2 or k1\?'),
        ('servo: {xyz: 1.0}', 'bad.yaml: servo has no setting xyz; it knows law,'),
        ('servo_node: {k1: 1.0}', 'parameters of servo_node must stand under ros__parameters'),
        ('servo_node: {ros__parameters: {kk1: 1.0}}', r'no setting kk1; did you mean k1'),
        ('/**: {ros__parameters: {kk1: 1.0}}', r'/\*\* has no setting kk1; did you mean k1\?'),
        ('/**: 3', 'parameters of /\\*\\* must stand under ros__parameters'),
        (
            'servo: {k1: 1.0, k2: 1.0}\nservo_node: {ros__parameters: {k1: 1.0}}',
            'k1 must be given once, got it in servo and in servo_node; keep one of them',
        ),
        ('servo: {k1: fast}', r"bad.yaml: servo: k1 must be float, got 'fast' \(str\)"),
        ('servo: {k1: .nan}', r'bad.yaml: servo: k1 must lie in \[0, 5\], got nan'),
        ('servo: {k1: -0.1}', r'bad.yaml: servo: k1 must lie in \[0, 5\], got -0.1'),
        ('servo: {law: best}', 'bad.yaml: servo: law must be one of paper, corrected, full'),
        ('servo: {finite_time: 1}', 'bad.yaml: servo: finite_time must be bool, got 1'),
        ('servo: {latch_engage: 0.2}', 'bad.yaml: servo: latch_engage must not exceed'),
        ('base: {model: cart}', "base: model must be one of pioneer, ackermann, got 'cart'"),
        ('camera: {rig: [1]}', r'camera: rig must be one of fixed, pan_tilt, got \[1\]'),
        ('base: {slip: 2001-01-01}', 'bad.yaml: base: slip must be float'),
        pytest.param(
            f'base: {{slip: 1{"0" * 400}}}', 'bad.yaml: base: slip must lie in', id='huge'
        ),
        ('points: {candidates: 9.5}', 'bad.yaml: points: candidates must be int, got 9.5'),
        ('- servo', r"bad.yaml: a scenario must map sections to settings, got \['servo'\]"),
        ('servo', "bad.yaml: a scenario must map sections to settings, got 'servo'"),
        ('servo: [k1]', r"bad.yaml: servo must map names to values, got \['k1'\]"),
        ('servo: fast', "bad.yaml: servo must map names to values, got 'fast'"),
        ('servo: 0', 'bad.yaml: servo must map names to values, got 0'),
        ('servo: []', r'bad.yaml: servo must map names to values, got \[\]'),
        ('servo: false', 'bad.yaml: servo must map names to values, got False'),
        ('servo: {k1: 1.0', 'bad.yaml: scenario is not YAML: .* in line 1'),
        ('servo: !!python/object:os.system {}', 'bad.yaml: scenario is not YAML'),
        ('servo: {k1: 2001-99-99}', 'bad.yaml: scenario is not YAML'),
        ('a\x00b', 'bad.yaml: scenario is not YAML'),
        ('run: !!timestamp x', 'bad.yaml: scenario is not YAML'),
        pytest.param('run: ' + '[' * 5000, 'bad.yaml: scenario is not YAML', id='deep'),
    ],
)
def test_a_bad_file_is_refused_in_one_clear_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as refused:
        load(written(tmp_path, text))
    assert '\n' not in str(refused.value)
    assert 'unicode string' not in str(refused.value)  # as PyYAML calls what is no file


@pytest.mark.parametrize('node', ['servo_node', '/servo_node', '/robot1/servo_node', '/**'])
def test_ros_parameters_of_the_servo_are_its_section(tmp_path: Path, node: str) -> None:
    values = '{k1: 0.5, min_features: 15, use_sim_time: true}'  # the tracker has min_features, too
    text = f'base: {{slip: 0.1}}\n{node}:\n  ros__parameters: {values}\n'
    scenario = load(written(tmp_path, text))
    assert scenario.servo == replace(Scenario().servo, k1=0.5, min_features=15)
    assert (scenario.base.slip, scenario.tracker) == (0.1, Scenario().tracker)


def test_sections_overrule_nodes_and_a_node_overrules_all_nodes(tmp_path: Path) -> None:
    text = """
    servo: {k1: 1.0}
    servo_node: {ros__parameters: {k2: 2.0, room: 0.5}}
    /**: {ros__parameters: {k1: 3.0, k2: 3.0, k_t: 0.3, max_features: 99}}
    """
    scenario = load(written(tmp_path, text))
    assert (scenario.servo.k1, scenario.servo.k2, scenario.servo.k_t) == (1.0, 2.0, 0.3)
    assert (scenario.servo.spiral_ratio, scenario.tracker.max_features) == (0.5, 99)


@pytest.mark.parametrize('name', ['servo', 'tracker'])
def test_the_parameter_file_of_a_node_is_a_scenario(name: str) -> None:
    scenario = load(SCENARIOS[0].parents[1] / f'{name}_node.yaml')
    assert isinstance(scenario, Scenario)


@pytest.mark.parametrize(
    ('name', 'reason'),
    [('none.yaml', 'No such file'), ('', 'Is a directory'), ('image.yaml', 'not text')],
)
def test_what_is_no_file_of_text_is_refused(tmp_path: Path, name: str, reason: str) -> None:
    (tmp_path / 'image.yaml').write_bytes(b'\x89PNG\xff\xfe')
    with pytest.raises(InputError, match=f'{name}: scenario cannot be read: {reason}'):
        load(tmp_path / name)


@pytest.mark.parametrize('path', SCENARIOS, ids=lambda path: path.stem)
def test_dead_zones_are_configured_in_the_servo_where_it_need_not_learn_them(path) -> None:
    servo, base = load(path).servo, load(path).base
    if path.stem in ('cheap', 'rough'):
        assert servo.dead_band_linear == servo.dead_band_angular == 0.0 < base.dead_zone_angular
        return
    assert servo.dead_band_linear >= base.dead_zone_linear
    assert servo.dead_band_angular >= base.dead_zone_angular


@pytest.mark.parametrize('path', SCENARIOS, ids=lambda path: path.stem)
def test_the_page_of_simulate_says_what_a_scenario_has(path: Path) -> None:
    page = (Path(__file__).parents[2] / 'docs/commands/simulate.md').read_text()
    assert f'`{path.stem}`' in page.split('## Scenarios')[1].split('##')[0]


@pytest.mark.parametrize(('name', 'frames'), [('nominal', 0), ('realistic', 1), ('harsh', 2)])
def test_a_command_is_late_by_whole_frames(name: str, frames: int) -> None:
    (path,) = (path for path in SCENARIOS if path.stem == name)
    scenario, period = load(path), period_ns(load(path).camera.frame_rate)
    start = Pose(0.0, 0.0, 0.0)
    base = Pioneer(replace(scenario.base, dead_zone_linear=0.0), start, seed=0)
    base.command(Command(Twist(0.3, 0.0)))
    base.advance(frames * period)
    assert base.pose == start
    base.advance((frames + 1) * period)
    # A full frame of speeding up is behind it.
    full = (1.0 - scenario.base.slip) * scenario.base.acceleration * period / 1e9
    assert base.twist.linear == pytest.approx(full, rel=0.02)


@pytest.mark.parametrize('path', RIGS, ids=lambda path: path.stem)
def test_a_rig_has_parameters_of_nodes_alone_and_wins_over_a_scenario(path: Path) -> None:
    harsh = next(each for each in SCENARIOS if each.stem == 'harsh')
    scenario, alone = load(harsh, path), load(None, path)
    assert scenario.disturbances == load(harsh).disturbances
    for node, body in yaml.safe_load(path.read_text()).items():
        name = node.rpartition('/')[2]
        assert body['ros__parameters'].keys() <= accepted_names(name)
        section = NODES[name]
        kind = {KINDS[section][0]} if section in KINDS else set()
        for key in body['ros__parameters'].keys() - CONNECTION - kind:
            values = {getattr(getattr(each, section), key) for each in (scenario, alone)}
            assert len(values) == 1, (node, key)


def test_a_mistake_is_that_of_the_file_in_which_it_is(tmp_path: Path) -> None:
    good, bad = written(tmp_path, 'servo: {k2: 1.0}'), tmp_path / 'worse.yaml'
    bad.write_text('servo: {k1: 99.0}')
    for files in ((good, bad), (bad, good)):
        with pytest.raises(InputError, match=rf'^{bad}: servo: k1'):
            load(*files)


def test_a_servo_whose_head_the_camera_lacks_is_refused_in_one_line(tmp_path: Path) -> None:
    message = 'camera must be on a head for a servo with rig pan_tilt, got one with rig fixed'
    with pytest.raises(InputError, match=message):
        load(written(tmp_path, 'servo: {rig: pan_tilt}'))
    with pytest.raises(InputError, match=message):
        Scenario().with_servo({'rig': 'pan_tilt'})


def test_the_nominal_scenario_and_the_pinhole_rig_are_the_defaults() -> None:
    assert load(SCENARIOS[0].with_name('nominal.yaml')) == Scenario()
    assert load(None, RIGS[0].with_name('pinhole.yaml')) == Scenario()


def test_harsh_is_worse_than_realistic_and_realistic_than_nominal() -> None:
    found = {path.stem: load(path) for path in SCENARIOS}
    nominal, realistic, harsh = (found[name] for name in ('nominal', 'realistic', 'harsh'))
    for part, names in WORSE.items():
        for name in names:
            values = [getattr(getattr(item, part), name) for item in (nominal, realistic, harsh)]
            assert values[0] <= values[1] < values[2], (part, name)


WORSE = {
    'base': ('wheel_ratio', 'slip', 'dead_zone_linear', 'dead_zone_angular', 'command_delay'),
    'camera': ('noise', 'gain_drift', 'jitter', 'tilt', 'roll', 'mount_forward'),
    'points': ('noise', 'outlier_ratio'),
    'disturbances': ('occlusion', 'person', 'light_wave'),
}


def test_servo_settings_can_be_changed_on_top_and_a_bad_one_is_refused() -> None:
    scenario = from_document({'servo': {'k1': 0.5}}, 'test').with_servo({'law': 'paper'})
    assert (scenario.servo.k1, scenario.servo.law) == (0.5, 'paper')
    with pytest.raises(InputError, match="servo: law must be one of .*got 'best'"):
        Scenario().with_servo({'law': 'best'})


def test_a_run_takes_over_what_the_scenario_says() -> None:
    scenario = from_document({'run': {'max_duration': 20}, 'base': {'slip': 0.1}}, 'test')
    loop, seeded = scenario.loop((1.0, -3.0, 5.0), 4), scenario.seeded(7)
    assert (loop.start, loop.seed, loop.max_duration) == ((1.0, -3.0, 5.0), 4, 20.0)
    assert (loop.base, loop.servo) == (scenario.base, scenario.servo)
    assert (seeded.camera.seed, seeded.servo.seed) == (7, 7)
