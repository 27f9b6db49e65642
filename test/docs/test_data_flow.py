"""The picture of the data flow: its nodes exist, its topics are theirs, and it stays small."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]
DOCS = ROOT / 'docs'
LARGEST_BYTES = 150_000


@pytest.fixture(scope='module')
def figure() -> ModuleType:
    spec = importlib.util.spec_from_file_location('data_flow', DOCS / 'data_flow_figure.py')
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_what_a_node_is_drawn_to_publish_is_in_its_source(figure: ModuleType) -> None:
    for node in figure.NODES:
        source = ROOT / 'visual_servo_epipolar' / 'nodes' / f'{node}.py'
        text = source.read_text(encoding='utf-8')
        for topic in figure.OUTPUTS[node].split():
            assert f"'{topic}'" in text, (node, topic)


def test_the_picture_is_drawn_and_small(figure: ModuleType, tmp_path: Path) -> None:
    figure.main(tmp_path / 'data_flow.png')
    assert 10_000 < (tmp_path / 'data_flow.png').stat().st_size < LARGEST_BYTES
    assert (DOCS / 'data_flow.png').stat().st_size < LARGEST_BYTES
