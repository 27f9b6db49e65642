"""Output files: tried out before a run, whole or not there after it."""

from errno import EACCES
import os
from pathlib import Path
from tempfile import TemporaryFile

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
