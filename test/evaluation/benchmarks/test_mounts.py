"""The bench of mounts: which cameras it drives, what it measures of their runs, its table."""

import json
import math
from typing import Any

import pytest

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.evaluation.benchmarks import mounts
from visual_servo_epipolar.evaluation.benchmarks.command import BENCHMARKS, FOLDERS
from visual_servo_epipolar.evaluation.benchmarks.mounts import (
    camera_of_size,
    CameraPlace,
    LEVEL,
    MountCell,
    SIZES,
)
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.sweeping.summary import summary_of

FAILURE = {'outcome': 'failed', 'reason': 'tracks lost for 5 s'}
BRIEF_S = 2.0


@pytest.fixture(scope='module')
def document() -> dict[str, Any]:
    """Return the document of two cells, a start each."""
    few = [mounts.of_mount('attitude', LEVEL), mounts.of_mount('yaw', CameraPlace(yaw=1.5))]
    return mounts.drive(few, 1, seed=0, say=lambda text: None)


def test_every_tilt_and_roll_and_every_yaw_and_place_is_driven_once() -> None:
    cells = [*mounts.on_features()]
    assert len({(it.group, it.name) for it in cells}) == len(cells)
    driven = [(it.group, it.mount) for it in cells]
    attitudes = {(m.tilt, m.roll) for group, m in driven if group == 'attitude'}
    assert attitudes == {(tilt, roll) for tilt in mounts.TILTS for roll in mounts.ROLLS}
    places = [(m.yaw, m.ahead, m.aside) for group, m in driven if group == 'yaw']
    wanted = len(mounts.YAWS) * len(mounts.AHEADS) * len(mounts.ASIDES)
    assert len(places) == len(set(places)) == wanted


def test_every_cell_is_a_scenario_that_tells_the_servo_nothing() -> None:
    for cell in (*mounts.on_features(), *mounts.on_features(quick=True)):
        scenario, at = cell.scenario(BRIEF_S), cell.mount
        mount = scenario.camera.mount
        angles = [math.degrees(angle) for angle in (mount.tilt, mount.roll, mount.yaw)]
        assert angles == pytest.approx([at.tilt, at.roll, at.yaw])
        assert (mount.forward, mount.left) == (at.ahead, at.aside)
        for section, names in (('camera', cell.camera), ('base', cell.base)):
            values = {name: getattr(getattr(scenario, section), name) for name in names}
            assert values == {k: tuple(v) if isinstance(v, list) else v for k, v in names.items()}
        assert (scenario.servo, scenario.tracker) == (Scenario().servo, Scenario().tracker)


@pytest.mark.parametrize(('width', 'height'), SIZES)
def test_a_size_keeps_the_field_of_view(width: int, height: int) -> None:
    cell = MountCell(group='size', name='', camera=camera_of_size(width, height))
    camera, usual = cell.scenario(BRIEF_S).camera.camera, Scenario().camera.camera
    assert camera.width / camera.fx == pytest.approx(usual.width / usual.fx)
    assert (camera.width, camera.height) == (width, height)


def test_each_cell_is_judged_by_its_own_runs_and_has_a_line(document: dict[str, Any]) -> None:
    level, yawed = document['rows']
    assert level['success_rate'] == 1.0
    assert level['arrived_but_wrong'] == 0
    assert level['wrong_geometry_s']['max'] < 1.0
    assert level['excursion']['max'] < 1.2
    assert (level['name'], yawed['name']) == ('level', 'yaw +1.5 deg')
    assert level['position_error_m'] != yawed['position_error_m']
    assert all('runs' not in row for row in document['rows'])
    json.dumps(document)
    lines = [line for line in mounts.table(document).splitlines() if line.startswith('|')]
    assert len(lines) == 2 * (2 + 1)
    assert len({line.count('|') for line in lines}) == 1
    assert lines[2].startswith('| level | 100 % | 0 |')


@pytest.mark.parametrize('missing', [math.nan, None], ids=str)
def test_a_camera_with_which_no_run_arrived_has_dashes(document, missing) -> None:
    runs = [{**FAILURE, 'max_distance_ratio': 5.0, 'wrong_geometry_s': 30.0}]
    row = document['rows'][0] | summary_of(runs)
    for name in ('position_error_m', 'heading_error_deg', 'duration_s'):
        row[name] = dict.fromkeys(row[name], missing)
    line = mounts.table({**document, 'rows': [row]}).splitlines()[-1]
    assert line == '| level | 0 % | 0 | - / - | - | 5.00 / 5.00 | 30.0 | - |'


def test_what_needs_a_folder_runs_only_if_it_is_named(monkeypatch, capsys) -> None:
    ran: list[str] = []

    class Fake:
        def __init__(self, name: str) -> None:
            self.name = name

        def run(self, **_: Any) -> dict[str, Any]:
            ran.append(self.name)
            return {}

        def table(self, _: Any) -> str:
            return self.name

    monkeypatch.setattr('visual_servo_epipolar.evaluation.benchmarks.command._benchmark', Fake)
    assert main(['bench']) == 0
    assert ran == [name for name in BENCHMARKS if name not in FOLDERS]
    for words in (['real'], ['routes', 'laws']):
        assert main(['bench', *words]) == 2
        assert f'{words[0]} must be followed by the FOLDER' in capsys.readouterr().err
    assert main(['bench', 'mounts_images']) == 2
    assert 'unknown benchmark mounts_images' in capsys.readouterr().err
