"""Databases of rosbag2, of any of its versions, read by sqlite3."""

from collections.abc import Collection, Iterator, Mapping
from contextlib import closing, ExitStack
from pathlib import Path
import sqlite3

from visual_servo_epipolar.bags.storages.stored import (
    CDR,
    StorageFile,
    StoredMessage,
    StoredTopic,
)
from visual_servo_epipolar.core.errors import InputError

JOURNALS = ('-wal', '-journal')  # what SQLite puts behind the name of a database


def sqlite_file(path: Path) -> StorageFile:
    """Open the database of a bag; nothing is written to it, or beside it."""
    with ExitStack() as stack:
        db = stack.enter_context(closing(read_only(path)))
        if not is_bag(db):
            raise InputError(f'{path}: a database without the tables of a bag; give another')
        rows = db.execute(
            'SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) FROM messages '
            'GROUP BY topic_id'
        ).fetchall()
        start_ns = min((row[2] for row in rows), default=0)
        end_ns = max((row[3] for row in rows), default=0)
        topics = _topics(db, {row[0]: row[1] for row in rows})
        stack.pop_all()

    def messages(ids: Collection[int]) -> Iterator[StoredMessage]:
        marks = ', '.join('?' * len(ids))
        return db.execute(
            f'SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) '
            'ORDER BY timestamp',
            tuple(ids),
        )

    return StorageFile(topics, start_ns, end_ns, messages, db.close)


def read_only(path: Path) -> sqlite3.Connection:
    """Open a database that is not written to; beside it neither, unless it has a journal."""
    mode = 'mode=ro' if journals(path) else 'mode=ro&immutable=1'
    return sqlite3.connect(f'{path.resolve().as_uri()}?{mode}', uri=True)


def journals(path: Path) -> list[Path]:
    """Return what a recorder that was killed left beside a database: it is part of it."""
    files = [path.resolve().with_name(path.resolve().name + ending) for ending in JOURNALS]
    return [item for item in files if item.is_file() and item.stat().st_size]


def is_bag(db: sqlite3.Connection) -> bool:
    """Return whether a database has the tables of a bag."""
    return bool(columns(db, 'topics')) and bool(columns(db, 'messages'))


def columns(db: sqlite3.Connection, table: str) -> set[str]:
    """Return the names of the columns of a table, none where it is not there."""
    return {row[1] for row in db.execute(f'PRAGMA table_info({table})')}


def _topics(db: sqlite3.Connection, counts: Mapping[int, int]) -> list[StoredTopic]:
    """Return the topics of a database; earlier versions say less about them."""
    definitions: dict[str, tuple[str, str]] = {}
    if 'encoded_message_definition' in columns(db, 'message_definitions'):
        for kind, text, schema in db.execute(
            'SELECT topic_type, encoded_message_definition, encoding FROM message_definitions '
            'WHERE topic_type IN (SELECT type FROM topics)'  # others may be damaged
        ):
            definitions.setdefault(kind, (text, schema))
    cursor = db.cursor()
    cursor.row_factory = sqlite3.Row
    return [
        StoredTopic(
            row['id'],
            row['name'],
            row['type'],
            *definitions.get(row['type'], ('', '')),
            row.get('serialization_format', CDR),
            row.get('offered_qos_profiles', ''),
            row.get('type_description_hash', ''),
            counts.get(row['id'], 0),
        )
        for row in map(dict, cursor.execute('SELECT * FROM topics ORDER BY id'))
    ]
