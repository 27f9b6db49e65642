"""Parts of a bag: the storage files to read, by metadata.yaml, or by what is in the folder."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from visual_servo_epipolar.bags import containers, metadata
from visual_servo_epipolar.core.errors import InputError

ADVICE = 'the bag is damaged or was left open by a crash; try --repair'


@dataclass(frozen=True, slots=True)
class BagParts:
    """Parts of a bag in their order, and notes on what of it is not read."""

    files: list[Path]
    notes: list[str]


def bag_parts(path: Path) -> BagParts:
    """
    Return the storage files of a bag.

    Raises InputError if it is none, one of its files is lost, or it cannot be read in this
    form.
    """
    if not path.exists():
        raise InputError(f'{path}: no such bag; {containers.EXPECTED}')
    if not path.is_dir():
        if not path.is_file():
            raise InputError(f'{path}: not a file; {containers.EXPECTED}')
        if path.stat().st_size == 0:
            raise InputError(f'{path}: it is empty, nothing was recorded; give another bag')
        containers.container(path)
        return BagParts([path], [])
    files, pending = containers.storage_files(path), containers.left_open(path)
    notes = [
        f'left open by a crash and not read: {item.relative_to(path)}; --repair completes it'
        for item in pending
    ]
    if (path / metadata.FILE).is_file():
        return BagParts(_files_by_metadata(path, files), notes)
    if not files and pending:
        raise InputError(f'{path}: it was left open by a crash, in its first file; try --repair')
    if not files:
        raise _no_bag(path)
    return BagParts(files, notes)


def _no_bag(folder: Path) -> InputError:
    what = containers.something_else(folder)
    return InputError(
        f'{folder}: not a bag{what}'
        if what
        else f'{folder}: not a bag: it has neither metadata.yaml nor .mcap or .db3 files; give '
        'the folder that was recorded, with --repair if a crash left it so'
    )


def _files_by_metadata(path: Path, files: list[Path]) -> list[Path]:
    """Return the files that metadata.yaml lists; one that was renamed is known by its bytes."""
    names, information = metadata.listed_files(path), metadata.information(path)
    if names is None or information is None:
        raise InputError(
            f'{path}: bag cannot be read: {metadata.FILE} is empty or broken; {ADVICE}'
        )
    _refuse_compression(path, information)
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
    return sorted(files, key=containers.part_number) if missing else listed


def _refuse_compression(path: Path, information: Mapping[str, Any]) -> None:
    mode = str(information.get('compression_mode') or 'none').lower()
    name = str(information.get('compression_format') or 'zstd').lower()
    if mode != 'none' and name != 'zstd':
        raise InputError(
            f'{path}: compressed by {name}, of which only zstd can be read; unpack it with '
            '"ros2 bag convert"'
        )
