"""What a node publishes and subscribes to, as its source has it."""

from collections.abc import Callable
from pathlib import Path
import re
from typing import TypeAlias

import pytest

Topics: TypeAlias = Callable[[Path], set[str]]


def topics(source: Path, maker: str) -> set[str]:
    """Return the topics that ``source`` gives to its calls of ``maker``."""
    call = rf"\.{maker}\(\s*\w+,\s*'([^']+)'"
    return set(re.findall(call, source.read_text(encoding='utf-8')))


@pytest.fixture(scope='session')
def published() -> Topics:
    return lambda source: topics(source, 'create_publisher')


@pytest.fixture(scope='session')
def subscribed() -> Topics:
    return lambda source: topics(source, 'create_subscription')
