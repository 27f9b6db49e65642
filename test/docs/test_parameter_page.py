"""docs/parameters.md and docs/upgrading.md are what `python docs/parameters.py` writes."""

from dataclasses import fields
import importlib.util
import inspect
from pathlib import Path
from types import ModuleType

import pytest

from visual_servo_epipolar.core.settings import range_of

DOCS = Path(__file__).parents[2] / 'docs'
PAGE = DOCS / 'parameters.md'


@pytest.fixture(scope='module')
def generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location('parameter_page', DOCS / 'parameters.py')
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_pages_are_what_the_settings_say(generator: ModuleType) -> None:
    pages = {'parameters.md': generator.page(), 'upgrading.md': generator.upgrading()}
    for name, text in pages.items():
        assert (DOCS / name).read_text(encoding='utf-8') == text, (
            f'docs/{name} is not up to date; run python docs/parameters.py'
        )


def test_every_group_of_settings_of_a_node_is_on_the_page(generator: ModuleType) -> None:
    for name in generator.NODES:
        module = importlib.import_module(f'visual_servo_epipolar.nodes.{name}')
        kinds = generator.settings_of(module)
        declared = inspect.getsource(module).count('parameters.declare(')
        assert len(kinds) == declared >= 2, name
        for item in (item for kind in kinds for item in fields(kind)):
            row = f'`{item.name}`' if range_of(item).internal else f'\n| `{item.name}` |'
            assert row in PAGE.read_text(encoding='utf-8'), item.name


def test_an_inherited_setting_stands_under_the_class_that_declares_it(generator) -> None:
    class Base:
        gain: float = 1.0

    class Whole(Base):
        rate: float = 2.0

    assert generator._owner(Whole, 'gain') is Base
    assert generator._owner(Whole, 'rate') is Whole
