"""What fae70b72 wrote is not left behind: routes, parameter files, runs; bags are in test/bags."""

from pathlib import Path

import pytest
import yaml

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
