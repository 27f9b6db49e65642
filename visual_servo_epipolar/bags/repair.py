"""
Repair: completes a bag that is damaged or was left open; nothing that was recorded is lost.

A file that is not whole is written anew beside its place, with every record that can be read; the
new file is counted, and the old one stays beside it under another name.
"""

from contextlib import suppress
from dataclasses import dataclass
import os
from pathlib import Path
import re

from rosbags.rosbag2 import WriterError

from visual_servo_epipolar.bags import containers, metadata
from visual_servo_epipolar.bags.reading.bag import DAMAGE
from visual_servo_epipolar.bags.salvaging.replacement import (
    free_name,
    repair_part,
    RepairedPart,
    survey_of,
)
from visual_servo_epipolar.core.errors import InputError

MOST_NAMED = 4  # topics that lost messages


@dataclass(frozen=True, slots=True)
class RepairReport:
    """Report on a repair: what is in the bag, and what was rewritten."""

    path: Path
    messages: int
    files: int
    rewritten: tuple[str, ...]  # names of the files that were not whole
    kept: tuple[str, ...]  # names under which they stay as they were
    lost_bytes: int  # of those, what could not be read
    lost_messages: tuple[str, ...]  # how many by topic, where the file says so
    described: bool  # whether metadata.yaml was written
    lost: tuple[str, ...] = ()  # names of files that are not there any more

    def __str__(self) -> str:
        text = f'{self.path}: {self.messages} messages in {self.files} files'
        if self.rewritten:
            text += f'; completed {", ".join(self.rewritten)}, '
            text += f'{self.lost_bytes or "no"} bytes could not be read'
            more = len(self.lost_messages) - MOST_NAMED
            if self.lost_messages:
                text += f' ({", ".join(self.lost_messages[:MOST_NAMED])}'
                text += f' and {more} topics more)' if more > 0 else ')'
        else:
            text += ', all whole' + (', metadata.yaml completed' if self.described else '')
        if self.kept:
            text += f'; what was there before is kept: {", ".join(self.kept)}'
        return text + (f'; lost: {", ".join(self.lost)}' if self.lost else '')


def repair(path: Path) -> RepairReport:
    """
    Make a rosbag2 folder, or one of its .mcap or .db3 files, readable again.

    Every byte is read. Files that are whole stay as they are; what remains of the others is
    written anew, with an index, and takes their place only when it is complete and counted: that
    needs as much free space. The old files stay beside as NAME.damaged. A metadata.yaml that is
    missing or broken is written anew, and one that lists files that are lost.

    Raises InputError if there is nothing to repair, no space to do it in, or the file is not
    ROS 2's.
    """
    path = containers.bag_path(path)
    try:
        files = _storage_files(path)
        folder = path if path.is_dir() else path.parent
        lost = _lost_files(folder, files) if path.is_dir() else ()
        surveys = [survey_of(file, folder) for file in files]
        parts = [repair_part(item) for item in surveys]
        kept = [part.kept for part in parts if part.kept]
        described = path.is_dir() and _describe(folder, parts, kept)
    except InputError:
        raise
    except (*DAMAGE, WriterError) as error:
        message = getattr(error, 'strerror', None) or error
        raise InputError(f'{path}: bag cannot be repaired: {message}; nothing was lost') from None
    return RepairReport(
        path,
        sum(part.info.count for part in parts),
        len(parts),
        tuple(part.info.file for part in parts if part.kept),
        tuple(kept),
        sum(part.lost_bytes for part in parts),
        tuple(text for part in parts for text in part.lost_messages),
        described,
        lost,
    )


def _storage_files(path: Path) -> list[Path]:
    """Return the storage files of a bag in their order; one being recorded has its own folder."""
    if path.is_dir():
        files = [*containers.storage_files(path), *containers.left_open(path)]
    else:
        files = [path] if path.is_file() else []
    kinds = {containers.container(file) for file in files}
    if containers.ROS1 in kinds:
        raise InputError(
            f'{path}: a bag of ROS 1, which stays as it is; try "rosbag reindex" of ROS 1'
        )
    if len(kinds) != 1:
        what = containers.something_else(path) if path.is_dir() else ''
        raise InputError(
            f'{path}: not a bag to repair{what}; give a rosbag2 folder with .mcap or .db3 files, '
            'or one of these'
        )
    return sorted(files, key=containers.part_number)


def _lost_files(folder: Path, files: list[Path]) -> tuple[str, ...]:
    """Return the names of files that are lost: by metadata.yaml, or by a gap in the numbers."""
    names = [file.name for file in files]
    expected = metadata.listed_files(folder)
    if expected is None:
        last = re.fullmatch(r'(.*_)(\d{1,4})', files[-1].stem)  # all up to it were there
        numbered = [f'{last[1]}{k}{files[-1].suffix}' for k in range(int(last[2]))] if last else []
        return tuple(item for item in numbered if item not in names)
    missing = [name for name in expected if name not in names]
    renamed = [name for name in names if name not in expected]
    return tuple(missing) if len(renamed) < len(missing) else ()


def _describe(folder: Path, parts: list[RepairedPart], kept: list[str]) -> bool:
    """Write metadata.yaml where it is missing, broken or out of date; the old one stays, too."""
    names = [part.info.file for part in parts]
    with containers.unpack(folder / names[0]) as plain:
        storage = containers.container(plain)
    if not any(part.kept for part in parts) and metadata.describes(folder, names, storage):
        return False
    mode = next((part.compression for part in parts if part.compression), '')
    content = metadata.document([part.info for part in parts], storage, mode)
    file = folder / metadata.FILE
    if file.is_file() and file.stat().st_size:
        content = metadata.with_notes_of(folder, content)
        old = free_name(file)
        with suppress(OSError):
            os.link(file, old)
            kept.append(old.name)
    metadata.write(folder, content)
    return True
