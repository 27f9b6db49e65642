"""Salvage of sqlite3: a database with what its journal holds, or what is left of its tables."""

from collections import Counter
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
import shutil
import sqlite3

from rosbags.rosbag2 import StoragePlugin, Writer

from visual_servo_epipolar.bags.metadata import VERSION
from visual_servo_epipolar.bags.salvaging.mcap_salvage import Key
from visual_servo_epipolar.bags.storage import close_writer
from visual_servo_epipolar.bags.storages.sqlite_file import is_bag, journals, read_only
from visual_servo_epipolar.core.errors import InputError


class SqliteSalvage:
    """Salvage of a database; ``counts`` are rows by table, and under topics those of each."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lost_bytes = 0
        self._expected = 0  # messages, by the index of their times
        self.counts: Counter[Key] = Counter()

    def is_sound(self) -> bool:
        """Return whether every page is as it was written, and nothing waits in a journal."""
        if journals(self.path):
            return False
        with suppress(sqlite3.Error), closing(read_only(self.path)) as db:
            if not _is_healthy(db):
                return False
            if not is_bag(db):
                if _definitions(db):
                    raise _no_bag(self.path)
                return False
            self.counts = _counts(db)
            return True
        return False

    def losses(self) -> list[str]:
        """Say how many messages a new file does not have, where the index can still be read."""
        lost = self._expected - self.counts.total()
        return [f'{lost} of {self._expected} messages'] if lost > 0 else []

    def write(self, target: Path) -> None:
        """Write all that is left to a new file; what a journal holds is part of it."""
        copy = target.with_name(f'copy_{target.name}')
        shutil.copyfile(self.path, copy)
        for journal in journals(self.path):
            ending = journal.name.removeprefix(self.path.resolve().name)
            shutil.copyfile(journal, copy.with_name(copy.name + ending))
        if _recover(copy):
            copy.rename(target)
        else:
            self._expected = _copy_tables(copy, target)
            self.lost_bytes = max(1, copy.stat().st_size - target.stat().st_size)
        with closing(read_only(target)) as db:
            tables = _definitions(db)
            if tables and not is_bag(db):
                raise _no_bag(self.path)
        if not tables:
            target.unlink()
            _write_empty(target)
        with closing(read_only(target)) as db:
            self.counts = _counts(db)


def _recover(copy: Path) -> bool:
    """Let SQLite bring in what is in the journal; return whether it is whole then."""
    with suppress(sqlite3.Error), closing(sqlite3.connect(copy)) as db:
        db.execute('SELECT COUNT(*) FROM sqlite_master').fetchone()
        db.execute('PRAGMA journal_mode = DELETE').fetchone()
        return _is_healthy(db)
    return False


def _is_healthy(db: sqlite3.Connection) -> bool:
    return bool(db.execute('PRAGMA quick_check').fetchall() == [('ok',)])


def _no_bag(path: Path) -> InputError:
    return InputError(f'{path}: a database without the tables of a bag; it stays as it is')


def _counts(db: sqlite3.Connection) -> Counter[Key]:
    rows = db.execute(
        'SELECT name, serialization_format, type, COUNT(*) FROM messages '
        'JOIN topics ON topics.id = topic_id GROUP BY topics.id'
    )
    counts: Counter[Key] = Counter()
    for name, encoding, kind, count in rows:
        counts[name, encoding, kind] += count
    return counts


def _copy_tables(source: Path, target: Path) -> int:
    """Copy each row that can be read, or raise ValueError; return the index's count."""
    rows = Counter[str]()
    with closing(sqlite3.connect(target)) as new, closing(sqlite3.connect(source)) as old:
        new.execute('PRAGMA user_version = 0')  # the file is there, whatever can be read
        old.execute('PRAGMA writable_schema = ON')  # or nothing is read of a file that is cut off
        for name, kind, sql in _definitions(old):
            with suppress(sqlite3.OperationalError):  # tables that SQLite itself keeps
                new.execute(sql)
            if kind != 'table' or name.startswith('sqlite_'):
                continue
            for row in _rows(old, name):
                marks = ', '.join('?' * len(row))
                added = new.execute(f'INSERT OR IGNORE INTO "{name}" VALUES ({marks})', row)
                rows[name] += added.rowcount
        new.commit()
        for name, count in rows.items():
            written = new.execute(f'SELECT COUNT(*) FROM "{name}"').fetchone()[0]
            if written != count:
                raise ValueError(f'{written} of {count} rows of {name} were written')
        with suppress(sqlite3.Error):
            return int(old.execute('SELECT COUNT(*) FROM messages').fetchone()[0])
    return 0


def _definitions(db: sqlite3.Connection) -> list[tuple[str, str, str]]:
    """Return name, kind and SQL of what a database is made of, tables first."""
    with suppress(sqlite3.Error):
        return db.execute(
            'SELECT name, type, sql FROM sqlite_master WHERE sql IS NOT NULL '
            "ORDER BY type != 'table', rowid"
        ).fetchall()
    return []


def _rows(db: sqlite3.Connection, table: str) -> Iterator[tuple[object, ...]]:
    """Yield the rows of a table from its beginning, then from its end, as far as they go."""
    for order in ('rowid', 'rowid DESC'):
        with suppress(sqlite3.DatabaseError):
            yield from db.execute(f'SELECT * FROM "{table}" ORDER BY {order}')
            return


def _write_empty(target: Path) -> None:
    writer = Writer(target.parent / 'empty', version=VERSION, storage_plugin=StoragePlugin.SQLITE3)
    writer.open()
    close_writer(writer)
    (writer.path / 'empty.db3').rename(target)
