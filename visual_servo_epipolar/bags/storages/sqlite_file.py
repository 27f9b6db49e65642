"""Databases of rosbag2, of any of its versions, read by sqlite3."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path
import sqlite3
from typing import Any

from visual_servo_epipolar.bags.storages.stored import CDR, StoredMessage, StoredTopic
from visual_servo_epipolar.core.errors import InputError

JOURNALS = ('-wal', '-journal')  # what SQLite puts behind the name of a database


class SqliteFile:
    """Database of a bag; nothing is written to it, or beside it."""

    def __init__(self, path: Path) -> None:
        self._db = read_only(path)
        try:
            if not is_bag(self._db):
                raise InputError(f'{path}: a database without the tables of a bag; give another')
            counts, self.start_ns, self.end_ns = self._counts()
            self.topics: Sequence[StoredTopic] = [
                _stored_topic(self._db, row, counts.get(row['id'], 0))
                for row in _rows(self._db, 'SELECT * FROM topics ORDER BY id')
            ]
        except BaseException:
            self._db.close()
            raise

    def __enter__(self) -> 'SqliteFile':
        return self

    def __exit__(self, *_: object) -> None:
        self._db.close()

    def messages(self, ids: Collection[int]) -> Iterator[StoredMessage]:
        """Return the messages of some topics in the order of time."""
        marks = ', '.join('?' * len(ids))
        return self._db.execute(
            f'SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) '
            'ORDER BY timestamp',
            tuple(ids),
        )

    def _counts(self) -> tuple[dict[int, int], int, int]:
        rows = self._db.execute(
            'SELECT topic_id, COUNT(*), MIN(timestamp), MAX(timestamp) FROM messages '
            'GROUP BY topic_id'
        ).fetchall()
        counts = {row[0]: row[1] for row in rows}
        start_ns, end_ns = (row[2] for row in rows), (row[3] for row in rows)
        return counts, min(start_ns, default=0), max(end_ns, default=0)


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


def _rows(db: sqlite3.Connection, query: str) -> list[dict[str, Any]]:
    cursor = db.execute(query)
    names = [item[0] for item in cursor.description]
    return [dict(zip(names, row, strict=True)) for row in cursor]


def _stored_topic(db: sqlite3.Connection, row: Mapping[str, Any], count: int) -> StoredTopic:
    """Return the topic in a row; earlier versions say less about it."""
    text, schema = '', ''
    if 'encoded_message_definition' in columns(db, 'message_definitions'):
        text, schema = db.execute(
            'SELECT encoded_message_definition, encoding FROM message_definitions '
            'WHERE topic_type = ?',
            (row['type'],),
        ).fetchone() or ('', '')
    return StoredTopic(
        row['id'],
        row['name'],
        row['type'],
        text,
        schema,
        row.get('serialization_format', CDR),
        row.get('offered_qos_profiles', ''),
        row.get('type_description_hash', ''),
        count,
    )
