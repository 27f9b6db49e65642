"""What a node publishes and subscribes to, as its source has it."""

from collections.abc import Callable
from pathlib import Path
import re
from typing import TypeAlias

import pytest

PUBLISHERS = r'\.(?:create)?_publisher\('
SUBSCRIBERS = r'(?:\.create_subscription|\bAdaptiveSubscription)\('
Topics: TypeAlias = Callable[[Path], set[str]]


def parts(source: Path) -> list[Path]:
    """Return ``source`` and the modules of its folder and those below that it stands on."""
    found = [source]
    for path in found:
        text = path.read_text(encoding='utf-8')
        names = re.findall(rf'from visual_servo_epipolar\.{source.parent.name}\.([\w.]+) im', text)
        modules = [source.parent / f'{name.replace(".", "/")}.py' for name in names]
        found += [it for it in dict.fromkeys(modules) if it.is_file() and it not in found]
    return found


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
