"""Parameter files: which of their sections reach a node; ROS passes over the others in silence."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
import re
from typing import Any

import yaml

PARAMETERS = 'ros__parameters'


@dataclass(frozen=True, slots=True)
class Section:
    """Section of a parameter file: the nodes it is for, as written, and names of parameters."""

    key: str
    names: frozenset[str]

    def reaches(self, node: str) -> bool:
        """Return whether the section is for a node of this full name, by the rules of rcl."""
        # As rclpy does it: /* becomes one part of a name, and so /** any number of them.
        pattern = ('/' + self.key.lstrip('/')).replace('/*', r'(/\w+)')
        return re.fullmatch(pattern, node) is not None


def sections(path: str) -> list[Section]:
    """Return the sections of a file that rcl has accepted; none if it cannot be read again."""
    if not Path(path).is_file():
        return []  # a pipe is read up, and to read it once more waits for ever
    try:
        document = yaml.safe_load(Path(path).read_text(encoding='utf-8'))
    except (OSError, ValueError, yaml.YAMLError):
        return []
    return list(_walk(document, ''))


def _walk(body: Any, key: str) -> Iterator[Section]:
    """Yield sections; namespaces may be nested."""
    if not isinstance(body, dict):
        return
    for name, inner in body.items():
        if name == PARAMETERS:
            yield Section(key, frozenset(_names(inner, '')))
        else:
            yield from _walk(inner, f'{key}/{str(name).strip("/")}' if key else str(name))


def _names(body: Any, prefix: str) -> Iterator[str]:
    """Yield names of parameters; nested ones are joined by points."""
    for name, value in body.items() if isinstance(body, dict) else ():
        if isinstance(value, dict):
            yield from _names(value, f'{prefix}{name}.')
        else:
            yield f'{prefix}{name}'
