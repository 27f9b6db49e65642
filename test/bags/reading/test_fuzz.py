"""Broken bags: one clear line and exit code 2; no traceback, no gigabytes, no hang."""

from collections.abc import Callable
import os
from pathlib import Path
import resource
import shutil
import struct
import time

from bagmaker import kind_of, Message, tiny_run, write_bag
import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from visual_servo_epipolar.commands.main import main

MUTATIONS = int(os.environ.get('BAG_MUTATIONS', '4'))  # of each of ten kinds
USUAL_S = 10.0  # a replay of this bag takes 0.1 s
MOST_MEMORY = 400_000  # that all of them may add to the peak of this process [kB]
LENGTHS = (2**64 - 1, 2**63, 2**40, 2**33, 2**32 - 1, 2**31, 2**20, 0)
Rng = np.random.Generator


@pytest.fixture(scope='module')
def tiny() -> list[Message]:
    return tiny_run()


@pytest.fixture(scope='module')
def whole(tiny, tmp_path_factory) -> Path:
    """Return a folder with the run as a bag of every kind."""
    folder = tmp_path_factory.mktemp('whole')
    write_bag(folder / 'mcap', tiny)
    write_bag(folder / 'zstd', tiny, compression=CompressionMode.STORAGE)
    write_bag(folder / 'sqlite3', tiny, storage=StoragePlugin.SQLITE3)
    write_bag(
        folder / 'message',
        tiny,
        storage=StoragePlugin.SQLITE3,
        compression=CompressionMode.MESSAGE,
    )
    return folder


def flipped(data: bytearray, rng: Rng) -> bytearray:
    for at in rng.integers(0, len(data), rng.integers(1, 9)):
        data[at] ^= 1 << int(rng.integers(8))
    return data


def cut(data: bytearray, rng: Rng) -> bytearray:
    return data[: int(rng.integers(0, len(data)))]


def overwritten(data: bytearray, rng: Rng) -> bytearray:
    """Put a length or an offset that cannot be into the file."""
    value = LENGTHS[int(rng.integers(len(LENGTHS)))]
    at = int(rng.integers(0, max(len(data) - 8, 1)))
    data[at : at + 8] = struct.pack('<Q', value)
    return data


def shortened(data: bytearray, rng: Rng) -> bytearray:
    first, second = sorted(rng.integers(0, len(data), 2).tolist())
    return data[:first] + data[second:]


DAMAGES = (flipped, cut, overwritten, shortened)


def damaged(path: Path, rng: Rng) -> None:
    """Damage the file at ``path``, near its ends as often as in the middle of its images."""
    data = bytearray(path.read_bytes())
    damage = DAMAGES[int(rng.integers(len(DAMAGES)))]
    size = min(len(data), 20_000)
    part = int(rng.integers(3))
    if part == 0:
        data = damage(data, rng)
    elif part == 1:
        data[:size] = damage(data[:size], rng)
    else:
        data[-size:] = damage(data[-size:], rng)
    path.write_bytes(data)


def of_file(name: str, pattern: str) -> Callable[..., Path]:
    def make(whole: Path, tiny: list[Message], path: Path, rng: Rng) -> Path:
        source = whole / name
        shutil.copytree(source, path)
        damaged(next(path.glob(pattern)), rng)
        return path if pattern == 'metadata.yaml' or rng.integers(2) else next(path.glob(pattern))

    return make


def of_messages(change: Callable[[list[Message], Rng], list[Message]]) -> Callable[..., Path]:
    def make(whole: Path, tiny: list[Message], path: Path, rng: Rng) -> Path:
        return write_bag(path, change(list(tiny), rng), kinds={'/other': 'std_msgs/msg/String'})

    return make


def bytes_of_messages(messages: list[Message], rng: Rng) -> list[Message]:
    for number in rng.integers(0, len(messages), 3).tolist():
        topic, log_ns, raw = messages[number]
        head = bytearray(raw[:200])
        changed = DAMAGES[int(rng.integers(len(DAMAGES)))](head, rng)
        messages[number] = topic, log_ns, bytes(changed) + raw[200:]
    return messages


def without_topics(messages: list[Message], rng: Rng) -> list[Message]:
    names = sorted({topic for topic, _, _ in messages})
    gone = set(rng.choice(names, int(rng.integers(1, len(names) + 1)), replace=False))
    return [item for item in messages if item[0] not in gone] or [('/other', 0, messages[0][2])]


def of_wrong_types(messages: list[Message], rng: Rng) -> list[Message]:
    names = sorted({topic for topic, _, _ in messages})
    first, second = rng.choice(names, 2, replace=False)
    swap = {str(first): str(second), str(second): str(first)}
    return [(topic, log, raw) for topic, log, raw in messages if topic not in swap] + [
        (swap[topic], log, raw) for topic, log, raw in messages if topic in swap
    ]


def in_jumping_time(messages: list[Message], rng: Rng) -> list[Message]:
    topic = str(rng.choice(['/image_raw', '/tracks', '/epipoles', '/ground_truth']))
    numbers = [n for n, item in enumerate(messages) if item[0] == topic]
    number = int(rng.choice(numbers[1:]))
    _, log_ns, raw = messages[number]
    sec = int(rng.choice([-100, -1, 100_000, 2**31 - 1]))
    messages[number] = topic, log_ns, raw[:4] + struct.pack('<i', sec) + raw[8:]
    return messages


KINDS: dict[str, Callable[..., Path]] = {
    'mcap': of_file('mcap', '*.mcap'),
    'compressed mcap': of_file('zstd', '*.mcap'),
    'sqlite3': of_file('sqlite3', '*.db3'),
    'metadata': of_file('mcap', 'metadata.yaml'),
    'bytes of messages': of_messages(bytes_of_messages),
    'missing topics': of_messages(without_topics),
    'wrong types': of_messages(of_wrong_types),
    'jumping time': of_messages(in_jumping_time),
    'sqlite3 folder': of_file('sqlite3', 'metadata.yaml'),
    'compressed messages': of_file('message', '*.db3'),
}


@pytest.mark.parametrize('kind', list(KINDS))
def test_a_broken_bag_is_one_clear_line(kind, whole, tiny, tmp_path, capfd) -> None:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    codes = []
    for seed in range(MUTATIONS):
        rng = np.random.default_rng([seed, len(kind)])
        path = KINDS[kind](whole, tiny, tmp_path / str(seed), rng)
        began = time.monotonic()
        codes.append(main(['replay', str(path), *(['--tracks'] if seed % 3 else [])]))
        assert time.monotonic() - began < USUAL_S, (kind, seed)
        shown = capfd.readouterr()
        if codes[-1] == 2:
            assert shown.out == '', (kind, seed)
            assert len(shown.err.splitlines()) == 1, (kind, seed, shown.err)
            assert shown.err.startswith('visual_servo replay: '), (kind, seed, shown.err)
            assert 20 < len(shown.err) < 700, (kind, seed, shown.err)
        else:
            assert shown.err == '', (kind, seed, shown.err)
    assert codes.count(2) > MUTATIONS // 5, codes  # most damage is found out
    assert set(codes) <= {0, 1, 2}
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    assert grown < MOST_MEMORY, kind


STORED = {name for name in KINDS if 'mcap' in name or 'sqlite3' in name or 'compressed' in name}


@pytest.mark.parametrize('kind', sorted(STORED))
def test_a_repair_keeps_the_bytes_of_a_broken_bag(kind, whole, tiny, tmp_path, capfd) -> None:
    for seed in range(max(MUTATIONS // 4, 1)):
        folder = tmp_path / str(seed)
        folder.mkdir()
        path = KINDS[kind](whole, tiny, folder / 'bag', np.random.default_rng([seed, len(kind)]))
        before = {item.read_bytes() for item in folder.rglob('*') if item.is_file()}
        code = main(['replay', str(path), '--repair'])
        shown = capfd.readouterr()
        assert code in (0, 1) or len(shown.err.splitlines()) == 1, (kind, seed, shown.err)
        after = {item.read_bytes() for item in folder.rglob('*') if item.is_file()}
        assert before <= after, (kind, seed)
        assert not list(folder.rglob('.*.partial')), (kind, seed)
        if code != 2:
            again = main(['replay', str(path), '--repair'])
            assert again == code, (kind, seed)
            assert {i.read_bytes() for i in folder.rglob('*') if i.is_file()} == after, seed
            capfd.readouterr()


def test_time_that_jumps_is_refused_by_name(tiny, tmp_path, capsys) -> None:
    messages = list(tiny)
    number = [n for n, item in enumerate(messages) if item[0] == '/tracks'][1]
    topic, log_ns, raw = messages[number]
    messages[number] = topic, log_ns, raw[:4] + struct.pack('<i', 99_999) + raw[8:]
    assert main(['replay', str(write_bag(tmp_path / 'jump', messages))]) == 2
    assert 'stamps of /tracks must not run backwards' in capsys.readouterr().err


def test_a_bag_without_messages_is_refused(tmp_path, capsys) -> None:
    assert main(['replay', str(write_bag(tmp_path / 'void', []))]) == 2
    assert 'no images or tracks to replay; it has no topics' in capsys.readouterr().err


def test_a_type_that_the_bag_defines_otherwise_is_refused(whole, tmp_path, capsys) -> None:
    path = shutil.copytree(whole / 'mcap', tmp_path / 'other')
    file = next(path.glob('*.mcap'))
    data = file.read_bytes()
    assert data.count(b'float64[9]  k #') or data.count(b'float64[9] k')
    file.write_bytes(data.replace(b'float64[9] k', b'float64[9] q'))
    assert main(['replay', str(file)]) == 2
    error = capsys.readouterr().err
    assert kind_of('/camera_info') in error or 'CameraInfo' in error
