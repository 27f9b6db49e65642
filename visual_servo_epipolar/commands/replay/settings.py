"""Settings to replay with: ``--set servo.k1=0.1``, and parameter files as nodes take them."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import yaml

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import hint, names_of, Settings
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.messages.settings_text import sections
from visual_servo_epipolar.nodes.startup import table

Changes = dict[str, dict[str, Any]]

Kinds = Mapping[str, type[Settings]]
KINDS: Kinds = {'servo': ServoSettings, 'tracker': TrackerSettings}
OF_ROUTES: Kinds = {'follow': FollowSettings, 'servo': ServoSettings}


def changes_of(words: Sequence[str], params: str | None = None, kinds: Kinds = KINDS) -> Changes:
    """
    Return settings by section; what is set by a word overrules the file.

    Raises InputError if a word is not SECTION.NAME=VALUE, with a section of ``kinds``, or the file
    is none of parameters. The values are not checked.
    """
    changes: Changes = {} if params is None else _from_file(Path(params))
    for word in words:
        name, equals, value = word.partition('=')
        section, dot, setting = name.partition('.')
        if not (equals and dot and setting and section in kinds):
            raise InputError(
                f'--set takes SECTION.NAME=VALUE with a section of {", ".join(kinds)}, as in '
                f'servo.k1=0.1, got {word!r}{_suggestion(setting if dot else section, kinds)}'
            )
        changes.setdefault(section, {})[setting] = _value(value)
    return changes


def _suggestion(setting: str, kinds: Kinds) -> str:
    """Return in words how to write a setting without its section, if there is one."""
    for section, kind in kinds.items():
        if setting in {item.name for item in fields(kind)}:
            return f'; did you mean {section}.{setting}?'
    return ''


def _value(text: str) -> Any:
    """Return what YAML makes of ``text``; 1e-3, a word to YAML, is a number as well."""
    try:
        value = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError):
        return text
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            pass
    return value


def _from_file(path: Path) -> Changes:
    try:
        nodes = sections(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise InputError(f'{path}: parameters cannot be read: {error.strerror}') from None
    except ValueError as error:
        raise InputError(f'{path}: {error}') from None
    changes: Changes = {}
    for key, values in nodes.items():
        heard = _nodes_of(key, values)
        for section, kind in KINDS.items():
            if f'{section}_node' not in heard:
                continue
            accepted = table.accepted_names(*heard)
            if unknown := _unknown(values, accepted):
                raise InputError(
                    f'{path}: {key} has no parameter {", ".join(unknown)}; '
                    f'{hint(unknown, sorted(accepted))}'
                )
            names = names_of(kind)
            fitting = {name: value for name, value in values.items() if name in names}
            changes.setdefault(section, {}).update(fitting)
    if not any(changes.values()):
        raise InputError(f'{path}: no parameters of servo_node or tracker_node in this file')
    return changes


def _nodes_of(key: str, values: Mapping[str, Any]) -> list[str]:
    """
    Return the nodes that a section is for.

    Under /** it is for those that know all of its names, as it was written for one of them, or
    for every node: servo and tracker both have a min_features, with different meanings.
    """
    if key != '/**':
        return [key.rpartition('/')[2]]
    whole = [node for node in table.NODES if not _unknown(values, table.accepted_names(node))]
    return whole or list(table.NODES)


def _unknown(values: Mapping[str, Any], names: set[str]) -> list[str]:
    return sorted(values.keys() - names - {'use_sim_time'})
