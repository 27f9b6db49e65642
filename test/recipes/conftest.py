"""Rows of another package: entry points that name objects of a test."""

from collections.abc import Callable
from importlib.metadata import EntryPoint

import pytest

from visual_servo_epipolar.core import registry


@pytest.fixture()
def install(monkeypatch: pytest.MonkeyPatch) -> Callable[[str, str, str], None]:
    """Return what installs a package whose entry point of a group is ``name = module:object``."""
    points: list[EntryPoint] = []
    monkeypatch.setattr(
        registry, 'entry_points', lambda group: [it for it in points if it.group == group]
    )

    def entered(group: str, name: str, value: str) -> None:
        points.append(EntryPoint(name, value, f'visual_servo_epipolar.{group}'))

    return entered
