"""What fae70b72 wrote is not left behind: routes, parameter files, runs, bags."""

from pathlib import Path
import shutil

import pytest
import yaml

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.repair import repair
from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.routes.places import PlaceFinder
from visual_servo_epipolar.core.routes.run import FOLLOWING, RouteRun
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.messages.route_folder import folder_bytes, read_route, write_route
from visual_servo_epipolar.nodes.startup import table
from visual_servo_epipolar.simulation.scenario import load, Scenario

EARLIER = Path(__file__).parent / 'earlier'
CONFIG = EARLIER / 'config'
PARAMETERS = sorted([*CONFIG.glob('*.yaml'), *CONFIG.glob('rigs/*.yaml')])
SCENARIOS = sorted(CONFIG.glob('scenarios/*.yaml'))


def test_a_route_of_version_1_is_read_whole() -> None:
    route = read_route(EARLIER / 'route')
    assert route.length == pytest.approx(1.182417)
    assert [view.way for view in route.views] == [0.0, pytest.approx(1.182417)]
    assert route.stations == [0, 1]
    assert min(len(view.structure) for view in route.views) > 100
    assert folder_bytes(EARLIER / 'route') > 1e5


def test_it_is_written_again_with_its_photographs_as_they_are(tmp_path: Path) -> None:
    write_route(read_route(EARLIER / 'route'), tmp_path / 'route')
    for name in ('000000.png', '000001.png'):
        assert (tmp_path / 'route' / name).read_bytes() == (EARLIER / 'route' / name).read_bytes()
    assert folder_bytes(tmp_path / 'route') < 0.9 * folder_bytes(EARLIER / 'route')


def test_it_is_followed_from_where_its_photograph_was_taken() -> None:
    route = read_route(EARLIER / 'route')
    image = route.views[0].image
    place = PlaceFinder(route).find(image)
    assert place is not None
    assert place.way == pytest.approx(0.0, abs=0.02)
    run = RouteRun(route, FollowSettings(), ServoSettings())
    steps = [run.step(image, number * 90_000_000) for number in range(2)]
    assert steps[-1].phase == FOLLOWING


@pytest.mark.parametrize('path', PARAMETERS, ids=lambda path: path.stem)
def test_every_parameter_of_an_earlier_file_is_there_or_answered_for(path: Path) -> None:
    known = table.accepted_names(*table.NODES)
    sections = yaml.safe_load(path.read_text()).values()
    names = {name for section in sections for name in section['ros__parameters']}
    assert names
    assert sorted(names - known) == []


@pytest.mark.parametrize('path', SCENARIOS, ids=lambda path: path.stem)
def test_an_earlier_scenario_is_loaded_but_for_what_has_gone(path: Path, tmp_path: Path) -> None:
    sections = yaml.safe_load(path.read_text(encoding='utf-8'))
    for section, values in sections.items():
        gone = getattr(getattr(Scenario(), section, None), 'GONE', {})
        for name in values.keys() & gone.keys():
            with pytest.raises(
                InputError, match=rf'no setting .*\b{name}\b.* any more; leave it out'
            ):
                load(path)
            del values[name]
    (tmp_path / path.name).write_text(yaml.safe_dump(sections), encoding='utf-8')
    document = load(tmp_path / path.name).document()
    for section, values in sections.items():
        given = {name: tuple(it) if isinstance(it, list) else it for name, it in values.items()}
        assert {name: document[section][name] for name in given} == given


def test_a_report_is_made_of_an_earlier_run(tmp_path: Path) -> None:
    assert main(['report', str(EARLIER / 'run'), '--out', str(tmp_path)]) == 0
    assert 'arrived' in (tmp_path / 'report.html').read_text(encoding='utf-8')


# A run of a second, two images of 160x128 px; only one of the bags holds images.
RECORDED = Path(__file__).parent / 'bags/recorded'
COUNTS = {
    '/camera_info': 2,
    '/cmd_vel': 2,
    '/diagnostics': 2,
    '/epipoles': 2,
    '/ground_truth': 3,
    '/phase': 3,
    '/servo_node/settings': 1,
    '/tracker_node/settings': 1,
    '/tracks': 2,
}
IMAGES = {'/image_raw': 2, '/tracker_node/desired/image_raw': 1}
BAGS = [('mcap', COUNTS), ('zstd', COUNTS | IMAGES), ('sqlite3', COUNTS)]


def counts(path: Path) -> dict[str, int]:
    """Return how many messages of each topic can be decoded."""
    with Bag(path) as bag:
        found = dict.fromkeys((name for name, item in bag.topics.items() if item.count), 0)
        for item in bag.messages(bag.topics):
            found[item.topic] += 1
    return found


@pytest.mark.parametrize(('name', 'expected'), BAGS)
def test_every_message_of_an_earlier_recorder_is_read(name, expected) -> None:
    assert counts(RECORDED / name) == expected
    for file in (RECORDED / name).glob('*_0.*'):
        assert counts(file)['/tracks'] > 0


@pytest.mark.parametrize('name', ['mcap', 'zstd', 'sqlite3'])
def test_a_bag_is_replayed(name, capsys) -> None:
    assert main(['replay', str(RECORDED / name)]) in (0, 1)  # laws may have changed since
    shown = capsys.readouterr()
    assert shown.err == ''
    assert f'2 steps from {"images" if name == "zstd" else "tracks"}, 0.5 s' in shown.out


def test_what_an_earlier_recorder_left_open_is_repaired(tmp_path) -> None:
    bag = shutil.copytree(RECORDED / 'mcap', tmp_path / 'mcap')
    (bag / 'metadata.yaml').unlink()
    data = (bag / 'mcap_1.mcap').read_bytes()
    (bag / 'mcap_1.mcap').write_bytes(data[:-1000])
    assert repair(bag).messages == sum(counts(bag).values()) == sum(COUNTS.values())
