"""
Files and folders that are there whole, or as before; and where those of the configuration are.

Files of a folder are written into one of their own in it, PARTIAL, which is renamed to COMPLETE
when all are there: from then on they count. They are moved to their places at once or, after a
kill, by the next write; ``place_of`` finds them until then.
"""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import errno
import os
from pathlib import Path
import shutil
import sys
from tempfile import mkdtemp, TemporaryFile
from typing import Any

PACKAGE = 'visual_servo_epipolar'
PARTIAL, COMPLETE = '.partial_', '.complete'
FORMER = '.former'  # in such a folder: names of files that go when its own come, a line each


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """
    Yield the file to write in place of ``path``, renamed to it unless the block raises.

    A link is followed. The file is on the disk before it is renamed: a power cut finds it whole.
    """
    path = Path(os.path.realpath(path))
    partial = path.with_name(f'.{path.name}.partial')
    try:
        yield partial
        _sync(partial)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes) -> None:
    """Write a file by rename, or not at all; folders on the way to it are made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.exists() and not path.is_file():  # a device or a pipe, which a rename would replace
        path.write_bytes(content)
        return
    with whole(path) as partial:
        partial.write_bytes(content)


def yaml_document(text: str, loader: Any = None) -> Any:
    """Return the document in a ``text`` of YAML; ValueError, with the line, if it is none."""
    import yaml  # late: the help of a command loads no library

    try:
        return yaml.load(text, loader or yaml.SafeLoader)
    except yaml.YAMLError as error:
        problem, mark = getattr(error, 'problem', None), getattr(error, 'problem_mark', None)
        where = '' if mark is None else f' in line {mark.line + 1}'
        raise ValueError(f'{problem or "it cannot be read"}{where}') from None
    except (ValueError, AttributeError):  # of a date, or a number of too many digits
        raise ValueError('it has a value that cannot be read') from None
    except RecursionError:
        raise ValueError('it is nested too deeply') from None


def try_out(folder: Path) -> None:
    """Write into ``folder``, or the nearest one above it that is there; OSError if that fails."""
    while not folder.exists():
        folder = folder.parent
    with TemporaryFile(dir=folder) as file:  # has no name: no kill can leave it behind
        file.write(b'tried out')


@contextmanager
def made_folder(folder: Path) -> Iterator[Path]:
    """
    Yield a ``folder`` with its links followed, made if it is missing.

    What was made goes again if the block fails or is interrupted. Raises OSError if it cannot be
    made, or nothing can be written into it.
    """
    folder = Path(os.path.realpath(folder))
    made = [item for item in (folder, *folder.parents) if not item.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        try_out(folder)
        yield folder
    except BaseException:
        for item in made:
            with suppress(OSError):  # another process has put something there
                item.rmdir()
        raise


@contextmanager
def all_at_once(folder: Path) -> Iterator[Path]:
    """
    Yield a folder to write files into; all are in ``folder`` once the block has ended, or none.

    They replace those of the same names, and those named in a file FORMER among them go; all else
    in ``folder`` stays. Leftovers of a kill are cleared. Raises OSError as ``made_folder`` does.
    """
    with made_folder(folder) as place:
        _settle(place)
        for left in place.glob(f'{PARTIAL}*'):
            shutil.rmtree(left, ignore_errors=True)
        partial = Path(mkdtemp(dir=place, prefix=PARTIAL))
        try:
            partial.chmod(0o755)
            yield partial
            for file in partial.iterdir():
                if (place / file.name).is_dir():
                    raise IsADirectoryError(errno.EISDIR, f'{file.name} is a folder there')
                _sync(file)
            partial.replace(place / COMPLETE)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
        _settle(place)


def place_of(folder: Path, name: str) -> Path:
    """Return where the file ``name`` is that ``all_at_once`` has written into ``folder``."""
    complete = folder / COMPLETE / name
    return complete if complete.is_file() else folder / name


def _settle(folder: Path) -> None:
    """Move what is complete to its place in ``folder``, whatever of it was moved before a kill."""
    complete = folder / COMPLETE
    if not complete.is_dir():
        return
    former = complete / FORMER
    if former.is_file():
        for name in former.read_text(encoding='utf-8').splitlines():
            (folder / Path(name).name).unlink(missing_ok=True)
        former.unlink()
    for file in complete.iterdir():
        file.replace(folder / file.name)
    complete.rmdir()


def _sync(path: Path) -> None:
    """Wait until the content of a file is on the disk."""
    with path.open('rb') as file:
        os.fsync(file.fileno())


def config_folders() -> Iterator[Path]:
    """Yield the folders that may hold the configuration, nearest first."""
    yield Path(__file__).resolve().parents[1] / 'config'
    for prefix in filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)):
        yield Path(prefix) / 'share' / PACKAGE / 'config'
    yield Path(sys.prefix) / 'share' / PACKAGE / 'config'


def config_names(kind: str) -> list[str]:
    """Return the names of all configuration files of a ``kind``: scenarios, rigs."""
    return sorted({p.stem for folder in config_folders() for p in (folder / kind).glob('*.yaml')})
