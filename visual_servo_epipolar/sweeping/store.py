"""Store: results on disk as workers bring them; a sweep that was killed is resumed from it."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from datetime import date
import fcntl
import json
import os
from pathlib import Path
from queue import Empty, SimpleQueue
import time
from typing import Any

from visual_servo_epipolar import __version__
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.sweeping.plan import Chunk, Key, SweepPlan
from visual_servo_epipolar.sweeping.provenance import commit, digest
from visual_servo_epipolar.sweeping.workers import Workers

FILE = 'runs.jsonl'
PATIENCE_S = 10.0  # without a result, after which the workers are checked

Header = dict[str, Any]
Results = list[dict[str, Any]]
Watch = Callable[[Sequence[dict[str, Any]]], None]


class Store:
    """
    The file runs.jsonl of one sweep: a header, then one line a run in the order they ended.

    It belongs to one process at a time. A last line that was cut off by a kill is dropped, and its
    run is done again. ``results`` are those so far, ``wall_s`` is the time they took [s].

    Raises InputError if the folder holds another sweep, or its file cannot be read or written,
    or is in use.
    """

    def __init__(self, folder: Path, plan: SweepPlan) -> None:
        self.path = folder / FILE
        self.results: dict[Key, dict[str, Any]] = {}
        self._before_s, self._began = 0.0, time.monotonic()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        except OSError as error:
            raise InputError(f'{self.path}: results cannot be kept: {error.strerror}') from None
        try:
            self._lock()
            self.header = self._open(header_of(plan))
        except BaseException:
            self.close()
            raise

    @property
    def wall_s(self) -> float:
        """Time spent on the runs so far, over all sessions [s]."""
        return self._before_s + time.monotonic() - self._began

    def add(self, chunk: Chunk, results: list[dict[str, Any]]) -> None:
        """Keep the results of ``chunk``; once this returns, no kill can take them away."""
        lines = []
        for index, result in zip(chunk.indices, results, strict=True):
            self.results[chunk.law, index] = result
            line = {'law': chunk.law, 'index': index, 'wall_s': self.wall_s, 'result': result}
            lines.append(json.dumps(line))
        self._append(lines)

    def close(self) -> None:
        """Let go of the file."""
        os.close(self._file)

    def __enter__(self) -> 'Store':
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f'{self.path}: another sweep is writing here; wait for it, or give another --out'
            ) from None

    def _open(self, wanted: Header) -> Header:
        """Read the file and return its header; write ``wanted`` if there is none."""
        content = self.path.read_bytes()
        whole = content.rfind(b'\n') + 1
        lines = content[:whole].splitlines()
        header = _parse(lines[0], f'{self.path}:1') if lines else wanted
        if 'sweep' not in header:
            raise InputError(f'{self.path}: not the results of a sweep; give another --out')
        if len(lines) < 2:  # no run ended
            os.ftruncate(self._file, 0)
            self._append([json.dumps(wanted)])
            return wanted
        _check(header, wanted, self.path)
        os.ftruncate(self._file, whole)
        self._read(lines[1:])
        return header

    def _read(self, lines: list[bytes]) -> None:
        for number, text in enumerate(lines, start=2):
            line = _parse(text, f'{self.path}:{number}')
            try:
                self.results[line['law'], line['index']] = line['result']
                self._before_s = line['wall_s']
            except KeyError as error:
                raise InputError(
                    f'{self.path}:{number}: lacks {error}; remove this line'
                ) from None

    def _append(self, lines: list[str]) -> None:
        data = memoryview(''.join(f'{line}\n' for line in lines).encode())
        try:
            while data:
                data = data[os.write(self._file, data) :]
            os.fsync(self._file)
        except OSError as error:
            raise InputError(f'{self.path}: results cannot be kept: {error.strerror}') from None


def header_of(plan: SweepPlan) -> Header:
    """Return the first line of the store of ``plan``."""
    return {
        'sweep': plan.identity(),
        'version': __version__,
        'code': digest(),
        'commit': commit(),
        'begun': date.today().isoformat(),
    }


def drive(plan: SweepPlan, store: Store, workers: Workers, watch: Watch) -> None:
    """
    Do the runs of ``plan`` that ``store`` does not have yet, and keep each as its chunk ends.

    ``watch`` is called after each chunk with its results. What a worker or its loss raises comes
    out here; the results until then are kept.
    """
    completed: SimpleQueue[Future[Results]] = SimpleQueue()
    pending: dict[Future[Results], Chunk] = {}
    for chunk in plan.chunks(store.results.keys(), workers.count):
        future = workers.submit(plan, chunk)
        pending[future] = chunk
        future.add_done_callback(completed.put)
    while pending:
        try:
            future = completed.get(timeout=PATIENCE_S)
        except Empty:
            workers.check()
            continue
        results = future.result()
        store.add(pending.pop(future), results)
        watch(results)


def _parse(text: bytes, where: str) -> dict[str, Any]:
    try:
        line = json.loads(text)
    except ValueError:
        line = None
    if not isinstance(line, dict):
        raise InputError(f'{where}: not a line of a sweep; remove it, or give another --out')
    return line


def _check(stored: Header, wanted: Header, path: Path) -> None:
    differences = list(_differences(stored['sweep'], wanted['sweep'], ''))
    if stored.get('code') != wanted['code']:
        differences.append(
            f'code {_code(stored)} there, {_code(wanted)} here',
        )
    if differences:
        more = f' and {len(differences) - 3} more' if len(differences) > 3 else ''
        raise InputError(
            f'{path} holds another sweep: {"; ".join(differences[:3])}{more}; give another --out, '
            'or remove this one'
        )


def _differences(stored: Any, wanted: Any, where: str) -> list[str]:
    if isinstance(stored, Mapping) and isinstance(wanted, Mapping):
        names = sorted(stored.keys() | wanted.keys())
        below = [(n, f'{where}.{n}' if where else n) for n in names]
        return [d for n, name in below for d in _differences(stored.get(n), wanted.get(n), name)]
    return [] if stored == wanted else [f'{where} {stored!r} there, {wanted!r} here']


def _code(header: Header) -> str:
    return f'{header.get("code")} (commit {header.get("commit") or "unknown"})'
