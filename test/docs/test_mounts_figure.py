"""The map of mounts: a cell for each camera, and a frame where a run was unsafe."""

from dataclasses import asdict
import importlib.util
import json
from pathlib import Path
from types import ModuleType
from typing import Any

from matplotlib.figure import Figure
import pytest
from sweeps import result

from visual_servo_epipolar.evaluation.benchmarks.mounts import on_features
from visual_servo_epipolar.sweeping.summary import summary_of

DOCS = Path(__file__).parents[2] / 'docs' / 'measurements'
FAILED = {'outcome': 'failed', 'reason': 'lost', 'position_error_m': 4.0}


@pytest.fixture(scope='module')
def figure() -> ModuleType:
    spec = importlib.util.spec_from_file_location('mounts_figure', DOCS / 'mounts_figure.py')
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def document(**changes: Any) -> dict[str, Any]:
    """Return a document in which half of the runs of each cell arrived, 2 mm off."""
    summary = summary_of([result(), result(**FAILED, **changes)])
    rows = [asdict(cell) | summary for cell in on_features()]
    head = {'source': 'features', 'region': 'front', 'starts': 2, 'seed': 0}
    return head | {'longest_s': 180.0, 'commit': 'abc', 'rows': rows}


def texts(drawn: Figure) -> list[str]:
    return [text.get_text() for axes in drawn.axes[:2] for text in axes.texts]


def frames(module: ModuleType, drawn: Figure) -> int:
    patches = [patch for axes in drawn.axes[:2] for patch in axes.patches]
    return sum(patch.get_linewidth() == 2.0 and not patch.get_fill() for patch in patches)


def test_each_camera_has_a_cell_with_arrivals_and_error(figure: ModuleType) -> None:
    drawn = figure.draw(document())
    cells = [cell for cell in on_features() if cell.group in figure.GROUPS]
    assert texts(drawn) == ['50 %\n2.0 mm'] * len(cells)
    assert frames(figure, drawn) == 0


@pytest.mark.parametrize('unsafe', [{'max_distance_ratio': 1.3}, {'wrong_geometry_s': 1.0}])
def test_a_camera_with_an_unsafe_run_is_framed(figure, unsafe) -> None:
    drawn = figure.draw(document(**unsafe))
    assert frames(figure, drawn) == len(texts(drawn))


def test_a_result_that_was_written_is_drawn(figure: ModuleType, tmp_path, capsys) -> None:
    source, target = tmp_path / 'mounts.json', tmp_path / 'mounts.png'
    source.write_text(json.dumps({'mounts': document()}))
    figure.main([str(source), str(target)])
    assert target.stat().st_size > 10_000
    assert '| level | 50 % |' in capsys.readouterr().out
