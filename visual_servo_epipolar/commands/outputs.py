"""Outputs of commands: checked before a run, complete or absent after it."""

from argparse import Namespace
from collections.abc import Mapping
from errno import EACCES
import json
import math
import os
from pathlib import Path
import sys
from typing import Any

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.files import try_out, write_whole


class OutputFile(str):
    """File that an option names, to be written; - is standard output."""

    def __new__(cls, name: str | Path) -> 'OutputFile':
        """Return the name with ~ as the folder it stands for."""
        return super().__new__(cls, os.path.expanduser(str(name)))

    def check(self) -> None:
        """Raise InputError if it cannot be written; leaves no trace."""
        path = Path(os.path.realpath(self))
        if self == '-':
            return
        if not Path(self).name or path.is_dir():
            raise InputError(f'{self!r}: result cannot be written: this is not the name of a file')
        try:
            if path.exists() and not os.access(path, os.W_OK):
                raise PermissionError(EACCES, os.strerror(EACCES))
            if not path.exists() or path.is_file():  # to open a pipe would end its reader
                try_out(path.parent)
        except OSError as error:
            raise InputError(f'{self}: result cannot be written: {error.strerror}') from None


class OutputFolder(OutputFile):
    """Folder that an option names, to be written into."""

    def check(self) -> None:
        """Raise InputError if nothing can be written into it; leaves no trace."""
        try:
            try_out(Path(os.path.realpath(self)))
        except OSError as error:
            raise InputError(
                f'{self}: nothing can be written there: {error.strerror}; give another --out'
            ) from None


def check_outputs(options: Namespace) -> None:
    """Raise InputError if anything that ``options`` name to be written cannot be."""
    for value in vars(options).values():
        if isinstance(value, OutputFile):
            value.check()


def publish(document: Mapping[str, Any], text: str, target: str | None) -> None:
    """Write ``document`` to ``target``, then print ``text``, unless it went to stdout."""
    write_json(document, target)
    if target != '-':
        print(text)


def write_json(document: Mapping[str, Any], target: str | None) -> None:
    """Write ``document`` to a file, by rename, or to standard output; nan becomes null."""
    if target is None:
        return
    text = json.dumps(_plain(document), indent=2, allow_nan=False) + '\n'
    if target == '-':
        sys.stdout.write(text)
        return
    try:
        write_whole(Path(target), text.encode())
    except OSError as error:
        raise InputError(f'{target}: result cannot be written: {error.strerror}') from None


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
