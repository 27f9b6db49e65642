"""
Settings in force as text: a ROS parameter file that can be kept and given to a node again.

Nodes publish it latched on ``~/settings``; a bag that holds it can be replayed with them.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cache
import platform
import re
from typing import Any

import cv2
import numpy as np
import yaml

from visual_servo_epipolar import __version__
from visual_servo_epipolar.core.settings import Settings
from visual_servo_epipolar.files import PACKAGE, yaml_document

VERSION = re.compile(r'^# ([A-Za-z]\w{0,39}): ([^\s-]\S{0,39})$', re.MULTILINE)
AFTER = re.compile(r'^# after_stamp_ns: (-?\d{1,19})$', re.MULTILINE)


@dataclass(frozen=True, slots=True)
class NodeSettings:
    """
    Settings of a node as it published them: ``values`` by name.

    They are in force after the image of ``after_stamp_ns``; None means from the beginning.
    ``versions`` are those of this package and of what it computes with, by name; bags of earlier
    versions have that of the package alone.
    """

    node: str
    values: dict[str, Any] = field(default_factory=dict)
    after_stamp_ns: int | None = None
    versions: Mapping[str, str] = field(default_factory=dict)

    @property
    def version(self) -> str:
        """Version of this package, '' if it is not stated."""
        return self.versions.get(PACKAGE, '')


def to_text(node: str, groups: Iterable[Settings], after_stamp_ns: int | None = None) -> str:
    """Return the settings of ``node``, its full name, as the YAML of a parameter file."""
    values = {
        name: list(value) if isinstance(value, tuple) else value
        for group in groups
        for name, value in asdict(group).items()
    }
    head = ''.join(f'# {name}: {version}\n' for name, version in installed_versions().items())
    if after_stamp_ns is not None:
        head += f'# after_stamp_ns: {after_stamp_ns}\n'
    return head + str(yaml.safe_dump({node: {'ros__parameters': values}}, sort_keys=False))


def from_text(text: str) -> NodeSettings:
    """
    Return what ``to_text`` wrote.

    Raises ValueError if ``text`` is not the parameter file of one node.
    """
    try:
        ((node, body),) = yaml_document(text).items()
        values = {str(name): value for name, value in body['ros__parameters'].items()}
    except (AttributeError, LookupError, TypeError, ValueError):
        raise ValueError(
            f'settings must be the parameter file of one node, got {text!r:.80}; connect '
            '~/settings of a node'
        ) from None
    after, versions = AFTER.search(text), dict(VERSION.findall(text))
    versions.pop('after_stamp_ns', None)
    return NodeSettings(str(node), values, int(after[1]) if after else None, versions)


@cache
def installed_versions() -> dict[str, str]:
    """Return the versions of this package, of Python, numpy and OpenCV, by name."""
    # Asked of the modules themselves: apt's cv2 has no metadata that pip could see.
    return {
        PACKAGE: __version__,
        'Python': platform.python_version(),
        'numpy': np.__version__,
        'OpenCV': str(cv2.__version__),
    }
