"""What a node publishes and subscribes to, as its source has it."""

from collections.abc import Callable
from pathlib import Path
import re
from typing import TypeAlias

import pytest

PUBLISHERS = r'(?:\.create_publisher\(|\breport_publisher\(\s*\w+,)'
SUBSCRIBERS = r'(?:\.create_subscription|\bAdaptiveSubscription)\('
Topics: TypeAlias = Callable[[Path], set[str]]


def parts(source: Path) -> list[Path]:
    """Return ``source`` and the modules that it imports from folders beside it."""
    text = source.read_text(encoding='utf-8')
    names = re.findall(
        rf'from visual_servo_epipolar\.{source.parent.name}\.(\w+\.[\w.]+) import', text
    )
    return [source, *(source.parent / f'{name.replace(".", "/")}.py' for name in names)]


def topics(source: Path, maker: str) -> set[str]:
    """Return the topics that ``source`` and its parts give to their calls of ``maker``."""
    call = rf"{maker}\s*\w+,\s*(?:\w+,\s*)?'([^']+)'"
    texts = (path.read_text(encoding='utf-8') for path in parts(source))
    return {topic for text in texts for topic in re.findall(call, text)}


@pytest.fixture(scope='session')
def published() -> Topics:
    return lambda source: topics(source, PUBLISHERS)


@pytest.fixture(scope='session')
def subscribed() -> Topics:
    return lambda source: topics(source, SUBSCRIBERS)
