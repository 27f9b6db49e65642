"""What the programs of docs/ write: parameters, pictures, mounts, the iterated scheme."""

from dataclasses import asdict, fields, replace
import json
import math
from pathlib import Path
from types import ModuleType
from typing import Any

from iterated import AttemptError, bound, errors, EXCURSION, fixed_point, Plant, PLANTS
from loaded import loaded
from node_process import row_of
import pytest
from sweeps import result

from visual_servo_epipolar.core.settings import range_of
from visual_servo_epipolar.evaluation.benchmarks.mounts import on_features
from visual_servo_epipolar.nodes.startup.table import NODES, settings_of
from visual_servo_epipolar.simulation.scenario import RunSettings, Scenario
from visual_servo_epipolar.sweeping.summary import summary_of

ROOT = Path(__file__).parents[2]
DOCS = ROOT / 'docs'
PAGE = DOCS / 'parameters.md'


@pytest.fixture(scope='module')
def generator() -> ModuleType:
    return loaded(DOCS / 'parameters.py')


def test_the_pages_are_what_the_settings_say(generator: ModuleType) -> None:
    pages = {'parameters.md': generator.page(), 'upgrading.md': generator.upgrading()}
    for name, text in pages.items():
        assert (DOCS / name).read_text(encoding='utf-8') == text, (
            f'docs/{name} is not up to date; run python docs/parameters.py'
        )


def test_every_setting_of_a_node_is_on_the_page(generator: ModuleType) -> None:
    assert {*generator.NODES} == NODES.keys()
    for item in (item for kind in settings_of(*NODES) for item in fields(kind)):
        row = f'`{item.name}`' if range_of(item).internal else f'\n| `{item.name}` |'
        assert row in PAGE.read_text(encoding='utf-8'), item.name


LARGEST_BYTES = 150_000
# The arrows from node to node: topic, its publisher, its subscribers.
LOOP = {
    'ground_truth': ('unicycle_node', ['camera_node']),
    'image_raw': ('camera_node', ['tracker_node']),
    'desired/image_raw': ('camera_node', ['tracker_node']),
    'camera_info': ('camera_node', ['tracker_node', 'servo_node']),
    'tracks': ('tracker_node', ['servo_node']),
    'cmd_vel': ('servo_node', ['unicycle_node']),
}
FILE = 'a bag'  # drawn as a topic is


@pytest.fixture(scope='module')
def figure() -> ModuleType:
    return loaded(DOCS / 'data_flow_figure.py')


def test_every_topic_that_is_drawn_leads_from_its_publisher_to_its_subscribers(figure) -> None:
    for node, topics in figure.OUTPUTS.items():
        assert set(topics.split()) <= row_of(node)[1], node
    for topic, (start, ends) in LOOP.items():
        assert topic in row_of(start)[1]
        assert [node for node in ends if topic not in row_of(node)[0]] == []
    (axes,) = figure.draw().axes
    texts = (text for text in axes.texts if text.get_fontfamily() == ['monospace'])
    drawn = {line for text in texts for line in text.get_text().split('\n')}
    others = {topic for topics in figure.OUTPUTS.values() for topic in topics.split()}
    assert drawn == LOOP.keys() | others | {FILE}


def test_the_picture_is_drawn_and_small(figure: ModuleType, tmp_path: Path) -> None:
    figure.main(tmp_path / 'data_flow.png')
    assert 10_000 < (tmp_path / 'data_flow.png').stat().st_size < LARGEST_BYTES
    assert (DOCS / 'data_flow.png').stat().st_size < LARGEST_BYTES


MEASUREMENTS = DOCS / 'measurements'
FAILED = {'outcome': 'failed', 'reason': 'lost', 'position_error_m': 4.0}


@pytest.fixture(scope='module')
def mounts_figure() -> ModuleType:
    return loaded(MEASUREMENTS / 'mounts_figure.py')


def document(**changes: Any) -> dict[str, Any]:
    """Return a document in which half of the runs of each cell arrived, 2 mm off."""
    summary = summary_of([result(), result(**FAILED, **changes)])
    rows = [asdict(cell) | summary for cell in on_features()]
    head = {'source': 'features', 'region': 'front', 'starts': 2, 'seed': 0}
    return head | {'longest_s': 180.0, 'commit': 'abc', 'rows': rows}


@pytest.mark.parametrize('unsafe', [{}, {'max_distance_ratio': 1.3}, {'wrong_geometry_s': 1.0}])
def test_each_camera_has_a_cell_that_is_framed_if_a_run_is_unsafe(mounts_figure, unsafe) -> None:
    axes = mounts_figure.draw(document(**unsafe)).axes[:2]
    texts = [text.get_text() for each in axes for text in each.texts]
    cells = [cell for cell in on_features() if cell.group in mounts_figure.GROUPS]
    assert texts == ['50 %\n2.0 mm'] * len(cells)
    patches = [patch for each in axes for patch in each.patches]
    framed = sum(patch.get_linewidth() == 2.0 and not patch.get_fill() for patch in patches)
    assert framed == len(cells) * bool(unsafe)


def test_a_result_that_was_written_is_drawn(mounts_figure: ModuleType, tmp_path, capsys) -> None:
    source, target = tmp_path / 'mounts.json', tmp_path / 'mounts.png'
    source.write_text(json.dumps({'mounts': document()}))
    mounts_figure.main([str(source), str(target)])
    assert target.stat().st_size > 10_000
    assert '| level | 50 % |' in capsys.readouterr().out


def test_a_film_of_a_rig_shows_the_image_and_the_map_beside_it(monkeypatch) -> None:
    program = loaded(DOCS / 'extensions_videos.py')
    monkeypatch.setitem(program.RIGS, 'pan', (program.RIGS['pan'][0], 256))
    whole = program.small

    def brief(rig: str, rows: int) -> Scenario:
        return replace(whole(rig, rows), run=RunSettings(max_duration=1.0))

    monkeypatch.setattr(program, 'small', brief)
    frames = program.film('pan')
    assert len(frames) == 3
    assert len({frame.shape for frame in frames}) == 1
    assert frames[0].shape[0] == program.ROWS and frames[0].shape[1] > 2 * program.ROWS


DISCRETE = 0.01  # size of an error that steps in time leave [m]
FIRST = AttemptError(0.1, -0.1)


@pytest.mark.parametrize('name', PLANTS)
def test_no_attempt_leaves_more_than_the_bound(name: str) -> None:
    plant = PLANTS[name]
    course = errors(plant, FIRST, 3)
    for before, after in zip(course, course[1:], strict=False):
        assert after.size <= bound(before.size, plant) + DISCRETE
    # What both epipoles feed back leaves nothing.
    exact = name in ('nominal', 'slip 5 %', 'focal length 10 % off')
    assert (bound(FIRST.size, plant) == 0.0) == exact


def test_unequal_wheels_contract_by_the_same_factor_each_time() -> None:
    sizes = [error.size for error in errors(PLANTS['wheel radii 5 %'], FIRST, 5)]
    factors = [after / before for before, after in zip(sizes[1:], sizes[2:], strict=False)]
    assert max(factors) < 0.6
    assert max(factors) - min(factors) < 0.03


def test_a_yaw_that_is_not_learnt_ends_at_a_fixed_point() -> None:
    # The way s = EXCURSION h leaves tan(yaw) s aside: h = sqrt of that at the end.
    plant = PLANTS['camera yaw 2 deg']
    last = errors(plant, FIRST, 5)[-1]
    assert last.size == pytest.approx(EXCURSION * math.tan(plant.yaw), rel=0.03)
    assert last.size <= fixed_point(plant)


def test_too_crooked_wheels_do_not_contract() -> None:
    crooked = Plant(curvature=1.2, backward=1.2)
    assert bound(0.1, crooked) > 0.1
    assert errors(crooked, AttemptError(0.01, 0.0), 1)[-1].size > 0.1
