"""Outputs of commands: tried out before a run, and whole or not there after it."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from errno import EACCES
import json
import math
import os
from pathlib import Path
import sys
from tempfile import TemporaryDirectory, TemporaryFile
from typing import Any

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.files import whole


def check_json(target: str | None) -> None:
    """Raise InputError if the result cannot be written to ``target``; leaves no trace."""
    if target is None or target == '-':
        return
    path = Path(target)
    if not path.name or path.is_dir():
        raise InputError(f'{target!r}: result cannot be written: this is not the name of a file')
    try:
        if not (path.exists() and _is_special(path)):
            _try_out(path.resolve().parent)
        elif not os.access(path, os.W_OK):  # to open a pipe would end its reader
            raise PermissionError(EACCES, os.strerror(EACCES))
    except OSError as error:
        raise InputError(f'{path}: result cannot be written: {error.strerror}') from None


def check_out(name: str | None) -> None:
    """Raise InputError if neither file nor folder ``name`` can be written; leaves no trace."""
    if name is None:
        return
    path = Path(name)
    try:
        _try_out(path.parent if path.is_file() else path)
    except OSError as error:
        raise InputError(
            f'{path}: nothing can be written there: {error.strerror}; give another --out'
        ) from None


def write_whole(path: Path, content: bytes) -> None:
    """Write a file by rename, or not at all; folders on the way to it are made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if _is_special(path):
        path.write_bytes(content)
        return
    with whole(path) as partial:
        partial.write_bytes(content)


def _is_special(path: Path) -> bool:
    """Whether ``path`` is a device, a pipe or a link, which a rename would replace."""
    return path.is_symlink() or (path.exists() and not path.is_file())


def _try_out(folder: Path) -> None:
    """Write into ``folder``, or into the nearest one above it that is there."""
    while not folder.exists():
        folder = folder.parent
    with TemporaryFile(dir=folder) as file:  # has no name: no kill can leave it behind
        file.write(b'tried out')


def output_folder(name: str) -> Path:
    """Return the folder called ``name``, created if missing; raises InputError if that fails."""
    _make(Path(name))
    return Path(name)


def publish(document: Mapping[str, Any], text: str, target: str | None) -> None:
    """Write ``document`` to ``target``, then print ``text``, unless standard output has it."""
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
    check_json(target)
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


@contextmanager
def output_folder_for(path: Path) -> Iterator[Path]:
    """
    Make the folder ``path``, and take away what was made if the block fails or is interrupted.

    Raises InputError if it cannot be made, or nothing can be written into it.
    """
    made = [item for item in (path, *path.parents) if not item.exists()]
    try:
        _make(path)
        yield path
    except BaseException:
        for item in made:
            with suppress(OSError):  # somebody else has put something there
                item.rmdir()
        raise


@contextmanager
def all_at_once(folder: Path) -> Iterator[Path]:
    """Yield a folder to write files into; those appear in ``folder`` when the block has ended."""
    with TemporaryDirectory(dir=folder, prefix='.partial_') as scratch:
        yield Path(scratch)
        for file in sorted(Path(scratch).iterdir()):
            file.replace(folder / file.name)


def _make(path: Path) -> None:
    try:
        path.mkdir(parents=True, exist_ok=True)
        _try_out(path)
    except OSError as error:
        raise InputError(
            f'{path}: folder cannot be made or written to: {error.strerror}; give another --out'
        ) from None
