"""Outputs of replay and report: tried out before the work, and whole or not there after it."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile

from visual_servo_epipolar.core.errors import InputError


@contextmanager
def output_folder_for(path: Path) -> Iterator[Path]:
    """
    Make the folder ``path``, and take away what was made if the block fails or is interrupted.

    Raises
    ------
    InputError
        If it cannot be made, or nothing can be written into it.

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
        with TemporaryFile(dir=path):  # has no name: nothing can leave it behind
            pass
    except OSError as error:
        raise InputError(
            f'{path}: folder cannot be made or written to: {error.strerror}; give another --out'
        ) from None
