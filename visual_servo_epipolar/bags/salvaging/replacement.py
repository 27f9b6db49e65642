"""
Replacement of one storage file: read to its end, written anew where it is not whole.

The new file is written beside the old one and counted; the old one stays under another name.
"""

from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
import os
from pathlib import Path
from tempfile import TemporaryDirectory

from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
    Qos,
)
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import parse_qos

from visual_servo_epipolar.bags import containers, metadata
from visual_servo_epipolar.bags.containers import ZSTD_MAGIC
from visual_servo_epipolar.bags.definitions import hash_of
from visual_servo_epipolar.bags.metadata import PartInfo
from visual_servo_epipolar.bags.reading.bag import DAMAGE
from visual_servo_epipolar.bags.salvaging.mcap_salvage import Key, McapSalvage
from visual_servo_epipolar.bags.salvaging.sqlite_salvage import SqliteSalvage
from visual_servo_epipolar.bags.storages.opening import open_storage
from visual_servo_epipolar.bags.storages.sqlite_file import journals
from visual_servo_epipolar.bags.storages.stored import kind_of, StorageFile, StoredTopic
from visual_servo_epipolar.core.errors import InputError

SCRATCH = '.repair_'
SALVAGES: Mapping[str, type[McapSalvage] | type[SqliteSalvage]] = {
    'mcap': McapSalvage,
    'sqlite3': SqliteSalvage,
}


@dataclass(frozen=True, slots=True)
class Survey:
    """Survey of a storage file: where it is and belongs, and whether it is whole."""

    file: Path
    destination: Path
    salvage: McapSalvage | SqliteSalvage
    sound: bool
    is_pending: bool  # in a folder of its own


@dataclass(frozen=True, slots=True)
class RepairedPart:
    """Storage file after the repair: what it holds, and what the repair did."""

    info: PartInfo
    compression: str  # none, message or file, as metadata.yaml has it
    kept: str = ''  # name of the old file, where it was rewritten
    lost_bytes: int = 0
    lost_messages: tuple[str, ...] = ()


def survey_of(file: Path, folder: Path) -> Survey:
    """Read a file from its beginning to its end."""
    pending = file.parent != folder
    destination = folder / file.name if pending else file.resolve()
    if pending and destination.exists():
        raise InputError(f'{folder}: it has {file.name} twice, here and in {file.parent.name}')
    with containers.unpack(file) as plain:
        salvage = SALVAGES[containers.container(plain)](plain)
        sound = salvage.is_sound()
    if not sound and plain != file:
        name = file.name.removesuffix('.zstd')
        raise InputError(
            f'{file}: it is damaged, and packed; "zstd -dc {file.name} > {name}" unpacks what is '
            'left, then repair that'
        )
    if not sound and isinstance(salvage, McapSalvage) and salvage.header.profile != 'ros2':
        raise InputError(
            f'{file}: it is damaged, but of profile {salvage.header.profile!r}, not "ros2", and '
            f'stays as it is; "mcap recover {file.name} -o NEW.mcap" completes such files'
        )
    return Survey(file, destination, salvage, sound, pending)


def repair_part(survey: Survey) -> RepairedPart:
    """Bring one file to its destination, written anew if it is not whole."""
    if survey.sound:
        if survey.is_pending:
            os.replace(survey.file, survey.destination)
            _remove_folder(survey.file.parent)
        return _part(survey)
    salvage, destination = survey.salvage, survey.destination
    with TemporaryDirectory(dir=destination.parent, prefix=SCRATCH) as scratch:
        target = Path(scratch, destination.name)
        salvage.write(target)
        _compare(survey.file, salvage.counts, target)
        kept = _put_in_place(target, survey)
    return replace(
        _part(survey),
        kept=kept,
        lost_bytes=salvage.lost_bytes,
        lost_messages=tuple(salvage.losses()),
    )


def _compare(file: Path, counts: Counter[Key], target: Path) -> None:
    """Refuse a new file that does not hold, channel by channel, all that was read."""
    new = SALVAGES[containers.container(target)](target)
    if not new.is_sound() or new.counts != counts:
        raise InputError(
            f'{file}: the new file holds {new.counts.total()} of the {counts.total()} records '
            'that were read; the old one stays as it is'
        )


def _put_in_place(target: Path, survey: Survey) -> str:
    """Give a file another name and put ``target`` in its place, so that one is always there."""
    file, destination = survey.file.resolve(), survey.destination
    with target.open('rb') as stream:
        os.fsync(stream.fileno())
    old = free_name(destination)
    journal_files = [*journals(file), file.with_name(f'{file.name}-shm')]
    try:
        os.link(file, old)
    except OSError:  # some file systems have no links
        file.rename(old)
    for journal in journal_files:  # SQLite must not take it for that of the new file
        with suppress(FileNotFoundError):
            journal.rename(old.with_name(old.name + journal.name.removeprefix(file.name)))
    os.replace(target, destination)
    if survey.is_pending:
        file.unlink(missing_ok=True)
        _remove_folder(file.parent)
    return old.name


def free_name(path: Path) -> Path:
    """Return the name for an old file that nothing has yet."""
    names = [f'{path.name}{containers.OLD}']
    names += [f'{path.name}.{number}{containers.OLD}' for number in range(1, 1000)]
    return next(item for item in map(path.with_name, names) if not item.exists())


def _remove_folder(folder: Path) -> None:
    """Remove the folder of an unfinished file, unless somebody has put something there."""
    with suppress(OSError):
        (folder / metadata.FILE).unlink(missing_ok=True)  # of this file alone
        folder.rmdir()


def _part(survey: Survey) -> RepairedPart:
    file = survey.destination if survey.is_pending else survey.file
    with containers.unpack(file) as plain, open_storage(plain) as stored:
        counts = {item.id: item.count for item in stored.topics}
        connections = tuple(_connection(item) for item in stored.topics)
        info = PartInfo(file.name, connections, counts, stored.start_ns, stored.end_ns)
        compression = 'file' if plain != file else _message_compression(stored)
    return RepairedPart(info, compression)


def _message_compression(stored: StorageFile) -> str:
    for item in stored.topics:
        _, _, data = next(stored.messages([item.id]), (0, 0, b''))
        if data.startswith(ZSTD_MAGIC):
            return 'message'
    return ''


def _connection(item: StoredTopic) -> Connection:
    qos: list[Qos] = []
    with suppress(*DAMAGE, ReaderError):
        qos = parse_qos(item.qos)
    is_defined = item.schema == 'ros2msg' and item.definition
    return Connection(
        item.id,
        item.topic,
        kind_of(item),
        MessageDefinition(MessageDefinitionFormat.NONE, ''),
        item.type_hash or (hash_of(kind_of(item), item.definition) if is_defined else ''),
        item.count,
        ConnectionExtRosbag2(item.encoding, qos),
        None,
    )
