"""Containers of bags, recognised by their first bytes, not by file names."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import re
import shutil
from tempfile import TemporaryDirectory

import zstandard

from visual_servo_epipolar.bags import metadata
from visual_servo_epipolar.core.errors import InputError

ROS1, ZSTD = 'ros1', 'zstd'  # beside mcap and sqlite3, as metadata.yaml names them
ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'  # no message of ROS 2 begins like this
MAGICS = {
    b'\x89MCAP0\r\n': 'mcap',
    b'SQLite format 3\x00': 'sqlite3',
    b'#ROSBAG V': ROS1,
    ZSTD_MAGIC: ZSTD,
}
NAMES = {'.mcap': 'mcap', '.db3': 'sqlite3', '.bag': ROS1, '.active': ROS1, '.zstd': ZSTD}
EXPECTED = 'give a rosbag2 folder, a .mcap, .db3 or .bag file'
OLD = '.damaged'  # how the old file of a repair is called, where it does not stay
ADVICE = 'the bag is damaged or was left open by a crash; try --repair'


def bag_path(path: Path) -> Path:
    """Return the folder of a bag where its metadata.yaml is given, else ``path`` itself."""
    return path.parent if path.name == metadata.FILE and path.is_file() else path


def container(path: Path) -> str:
    """Return what a file is by its bytes, or name if damaged; raises InputError for others."""
    kind = by_magic(path) or NAMES.get(path.suffix.lower(), '')
    if not kind:
        raise InputError(f'{path}: not a bag; {EXPECTED}')
    return kind


def storage_files(folder: Path) -> list[Path]:
    """Return the storage files of rosbag2 in a folder, by their bytes or names, in order."""
    files = [item for item in folder.iterdir() if item.is_file() and _is_storage(item)]
    names = {item.name for item in files}
    return sorted((it for it in files if repaired_name(it) not in names), key=part_number)


def repaired_name(path: Path) -> str:
    """Return the name of the file with the remains of a damaged one, beside which it stands."""
    return f'{path.stem}.repaired.mcap'


def part_number(path: Path) -> tuple[int, str]:
    """Return the key that brings the parts of a recording into their order."""
    digits = re.search(r'(\d{1,9})$', path.name.partition('.')[0])
    return (int(digits[1]) if digits else 0, path.name)


def left_open(folder: Path) -> list[Path]:
    """Return the files in folders of their own, as an earlier recorder leaves them if killed."""
    bags = {item.stem.rpartition('_')[0] for item in folder.iterdir() if _is_storage(item)}
    bags.add(folder.resolve().name)
    return [
        item
        for item in folder.glob('*/*')
        if item.suffix in metadata.SUFFIXES.values()
        and item.parent.name == item.stem
        and re.fullmatch(r'.+_\d+', item.stem)
        and item.stem.rpartition('_')[0] in bags
        and not (item.is_symlink() or (folder / repaired_name(item)).exists())
    ]


def something_else(folder: Path) -> str:
    """Return what a folder without storage files has instead, as the tail of a sentence."""
    bags = sorted(item.parent for item in folder.glob(f'*/{metadata.FILE}'))
    bags += sorted(item for item in folder.iterdir() if item.suffix == '.bag')
    if bags:  # the folder of a demo, or one of several bags
        return f', but a folder with one; give {bags[0]}'
    return ''


@contextmanager
def unpack(path: Path) -> Iterator[Path]:
    """Yield a file, or what zstd packed into it, for as long as the block lasts."""
    if container(path) != ZSTD:
        yield path
        return
    with TemporaryDirectory(prefix='bag_') as folder:
        plain = Path(folder, path.name.removesuffix('.zstd'))
        decompressor = zstandard.ZstdDecompressor()
        with (
            path.open('rb') as file,
            decompressor.stream_reader(file, read_across_frames=True) as packed,
            plain.open('wb') as target,
        ):
            shutil.copyfileobj(packed, target)
        yield plain


def by_magic(path: Path) -> str:
    """Return what a file is by its first bytes, '' if they are of no bag."""
    with path.open('rb') as file:
        head = file.read(max(map(len, MAGICS)))
    return next((name for magic, name in MAGICS.items() if head.startswith(magic)), '')


def _is_storage(path: Path) -> bool:
    if not path.is_file() or path.suffix == OLD or path.name.startswith('.'):
        return False
    inner = path.name.lower().removesuffix('.zstd')
    named = inner.endswith(tuple(metadata.SUFFIXES.values()))
    return named or by_magic(path) in metadata.SUFFIXES


def bag_parts(path: Path) -> tuple[list[Path], list[str]]:
    """
    Return the storage files of a bag in their order, and notes on what of it is not read.

    Raises InputError if it is none, or lacks one.
    """
    if not path.exists():
        raise InputError(f'{path}: no such bag; {EXPECTED}')
    if not path.is_dir():
        if not path.is_file():
            raise InputError(f'{path}: not a file; {EXPECTED}')
        if path.stat().st_size == 0:
            raise InputError(f'{path}: it is empty, nothing was recorded; give another bag')
        container(path)
        return [path], []
    files, pending = storage_files(path), left_open(path)
    if (path / metadata.FILE).is_file():
        files = _files_by_metadata(path, files)
    elif not files and pending:
        raise InputError(f'{path}: it was left open by a crash, in its first file; try --repair')
    elif not files:
        what = something_else(path) or (
            ': it has neither metadata.yaml nor .mcap or .db3 files; give the folder that was '
            'recorded, with --repair if a crash left it so'
        )
        raise InputError(f'{path}: not a bag{what}')
    return files, [
        f'left open by a crash and not read: {item.relative_to(path)}; --repair completes it'
        for item in pending
    ]


def _files_by_metadata(path: Path, files: list[Path]) -> list[Path]:
    """Return the files that metadata.yaml lists; one that was renamed is known by its bytes."""
    names, information = metadata.listed_files(path), metadata.information(path)
    if names is None or information is None:
        raise InputError(
            f'{path}: bag cannot be read: {metadata.FILE} is empty or broken; {ADVICE}'
        )
    mode = str(information.get('compression_mode') or 'none').lower()
    name = str(information.get('compression_format') or 'zstd').lower()
    if mode != 'none' and name != 'zstd':
        raise InputError(
            f'{path}: compressed by {name}, of which only zstd can be read; unpack it with '
            '"ros2 bag convert"'
        )
    listed = [path / name for name in names]
    missing = [item for item in listed if not item.is_file()]
    renamed = [item for item in files if item not in listed]
    if missing and len(renamed) != len(missing):
        raise InputError(
            f'{path}: bag cannot be read: it lacks {", ".join(item.name for item in missing)}, '
            f'which {metadata.FILE} lists; put it back'
            + (', or go on without it by --repair' if files else '')
        )
    if not listed:
        raise InputError(f'{path}: bag cannot be read: {metadata.FILE} lists no file; {ADVICE}')
    return sorted(files, key=part_number) if missing else listed
