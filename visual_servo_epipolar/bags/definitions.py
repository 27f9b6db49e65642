"""Message definitions and their hashes: they make a bag readable without the packages."""

from collections.abc import Iterator, Mapping
from functools import cache
import os
from pathlib import Path
import sys
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg, get_typestore, Stores, TypesysError

from visual_servo_epipolar.core.errors import InputError


@cache
def types_of_ros() -> Any:
    """Return the types of ROS 2; those read here have not changed since dashing."""
    return get_typestore(Stores.ROS2_JAZZY)


def definition(kind: str, type_hash: str = '') -> tuple[str, str]:
    """
    Return the definition of a message type, with those it is made of, and its hash.

    ``kind`` is such as sensor_msgs/msg/Image, ``type_hash`` that which the publisher states, if
    any. Raises InputError if no definition with this hash is known, or installed as a .msg file.
    """
    expected = type_hash if type_hash.startswith('RIHS01_') else ''
    for lookup in (_types_of_jazzy, _types_of_installed_files):
        store = lookup(kind)
        if store is not None:
            digest = str(store.hash_rihs01(kind))
            if expected in ('', digest):
                return store.generate_msgdef(kind, ros_version=2)[0], digest
    raise InputError(
        f'no definition of {kind} {expected} is known; source the workspace that defines it'
    )


def _types_of_jazzy(kind: str) -> Any:
    """Return the types of a stock Jazzy if ``kind`` is one of them."""
    return types_of_ros() if kind in types_of_ros().fielddefs else None


def _types_of_installed_files(kind: str) -> Any:
    """Return the types that installed .msg files make of ``kind``, or None."""
    types: dict[str, Any] = {}
    pending = [kind]
    while pending:
        name = pending.pop()
        path = _message_file(name)
        if path is None:
            return None
        try:
            types |= get_types_from_msg(path.read_text(encoding='utf-8'), name)
        except TypesysError:
            return None
        pending += [item for item in _components(types[name][1]) if item not in types]
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    return store


def _message_file(kind: str) -> Path | None:
    """Return the .msg file of ``kind`` in the workspaces that are sourced."""
    package, _, name = kind.partition('/msg/')
    prefixes = filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep))
    for prefix in (*prefixes, sys.prefix):
        path = Path(prefix, 'share', package, 'msg', f'{name}.msg')
        if path.is_file():
            return path
    return None


def _components(fields: Mapping[Any, Any] | list[Any]) -> Iterator[str]:
    """Yield the names of the messages that the fields of a message are made of."""
    for _, (kind, content) in fields:
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            kind, content = content[0]
        if kind == Nodetype.NAME:
            yield content
