"""Repair: what is whole in a bag that was left open, or is damaged, can be read; nothing goes."""

from collections.abc import Iterator
from contextlib import closing, contextmanager
import os
from pathlib import Path
import shutil
import signal
import sqlite3
import subprocess
import sys
from tempfile import TemporaryDirectory

from bag_reading import files_of_at_most, read_back, recorded, TEXT, until, words
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mixed_mcap import chunk_offsets, content, SOME, write_mixed
import pytest
from rosbags.highlevel import AnyReader

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.repair import repair
from visual_servo_epipolar.core.errors import InputError

RECORDED = Path(__file__).parent / 'recorded'
COMPRESSIONS = list(CompressionType)
ZSTD = CompressionType.ZSTD
TWENTY = SOME[:20]


def files_below(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob('*'))
        if path.is_file()
    }


def cut(file: Path, part: float = 0.9) -> bytes:
    """Cut a file off, and return what is left."""
    file.write_bytes(file.read_bytes()[: int(part * file.stat().st_size)])
    return file.read_bytes()


def messages_in(path: Path) -> int:
    with Bag(path) as bag:
        return sum(1 for _ in bag.messages(bag.topics))


@pytest.mark.parametrize('kind', ['mcap', 'zstd', 'sqlite3'])
def test_a_whole_bag_stays_as_it_is(tmp_path, kind) -> None:
    bag = shutil.copytree(RECORDED / kind, tmp_path / kind)
    before = files_below(bag)
    assert str(repair(bag)).endswith('messages; all whole')
    assert files_below(bag) == before


@pytest.mark.parametrize('text', ['', '{', '3', 'rosbag2_bagfile_information: {version: 9}'])
def test_metadata_that_are_broken_are_set_aside(tmp_path, text) -> None:
    bag = shutil.copytree(RECORDED / 'zstd', tmp_path / 'zstd')
    whole = repair(bag).messages
    (bag / 'metadata.yaml').write_text(text)
    report = repair(bag)
    assert report.messages == whole == messages_in(bag)
    assert f'with "ros2 bag reindex {bag}"' in str(report)
    assert (bag / 'metadata.yaml.damaged').read_text() == text
    assert str(repair(bag)).endswith('all whole')


def test_of_a_file_cut_off_what_is_whole_is_written_beside_it(tmp_path) -> None:
    bag = recorded(tmp_path)
    (bag / 'metadata.yaml').unlink()
    shutil.copy(bag / 'bag_0.mcap', bag / 'bag_1.mcap')
    left = cut(bag / 'bag_1.mcap')
    before = files_below(bag)
    report = repair(bag)
    assert 100 < report.messages < 200
    assert f'; bag_1.repaired.mcap holds {report.messages - 100} messages of bag_1.mcap' in (
        str(report)
    )
    assert f'of {len(left)} (it ends at byte {len(left)}' in str(report)
    assert str(report).endswith('what lies behind is lost')
    after = files_below(bag)
    assert after.keys() - before.keys() == {'bag_1.repaired.mcap'}
    assert after.items() >= before.items()
    assert 'all whole' in str(repair(bag))
    assert messages_in(bag) == report.messages


def test_a_lost_file_is_named_and_the_others_are_read(tmp_path) -> None:
    bag = shutil.copytree(RECORDED / 'mcap', tmp_path / 'mcap')
    whole = messages_in(bag)
    (bag / 'mcap_1.mcap').unlink()
    assert 'mcap_1.mcap' in str(repair(bag))
    assert 0 < messages_in(bag) < whole


@pytest.mark.parametrize('part', [0.99, 0.5, 0.1])
def test_a_single_file_is_repaired_and_indexed(tmp_path, part) -> None:
    bag = recorded(tmp_path)
    sent = read_back(bag)
    left = cut(bag / 'bag_0.mcap', part)
    report = repair(bag / 'bag_0.mcap')
    assert report.path == bag / 'bag_0.repaired.mcap'
    assert read_back(report.path) == sent[: report.messages]
    with report.path.open('rb') as stream:
        assert make_reader(stream).get_summary() is not None
    assert (bag / 'bag_0.mcap').read_bytes() == left
    before = files_below(bag)
    assert repair(bag / 'bag_0.mcap').path == report.path
    assert files_below(bag) == before
    (bag / 'bag_0.mcap').write_bytes(left[:-1])  # another one, of the same name
    with pytest.raises(InputError, match='bag_0.repaired.mcap is older than bag_0.mcap'):
        repair(bag / 'bag_0.mcap')


def test_definitions_and_qos_survive(tmp_path) -> None:
    bag = recorded(tmp_path)
    with AnyReader([bag / 'bag_0.mcap']) as reader:
        (before,) = reader.connections
    cut(bag / 'bag_0.mcap', 0.99)
    with AnyReader([repair(bag / 'bag_0.mcap').path]) as reader:
        (after,) = reader.connections
    for name in ('topic', 'msgtype', 'msgdef', 'digest', 'ext'):
        assert getattr(after, name) == getattr(before, name), name


@pytest.mark.parametrize('compression', COMPRESSIONS)
@pytest.mark.parametrize('number', [3, -1])
def test_behind_a_damaged_chunk_all_is_lost_and_reported(tmp_path, compression, number) -> None:
    file = write_mixed(tmp_path / 'a.mcap', compression=compression)
    whole = content(file)['messages']
    data = bytearray(file.read_bytes())
    at = chunk_offsets(file)[number]
    data[at + 120] ^= 0xFF
    file.write_bytes(data)
    report = repair(file)
    assert content(report.path)['messages'] == whole[: report.messages]
    assert report.messages < 120
    assert f'holds {report.messages} messages of a.mcap, which is damaged at byte' in str(report)
    assert str(report).endswith(': what lies behind is lost')
    assert file.read_bytes() == data


def test_cut_at_any_byte_all_that_is_whole_before_is_kept(tmp_path) -> None:
    data = write_mixed(tmp_path / 'whole.mcap', TWENTY, compression=ZSTD).read_bytes()
    whole = content(tmp_path / 'whole.mcap')['messages']
    kept_before = 0
    for size in range(len(data) // 4, len(data), len(data) // 20):
        file = tmp_path / f'{size}.mcap'
        file.write_bytes(data[:size])
        report = repair(file)
        left = content(report.path)['messages']
        assert left == whole[: len(left)], size
        assert report.messages == len(left) >= kept_before
        kept_before = len(left)
    assert kept_before == len(whole)


@pytest.mark.parametrize('name', ['nothing', 'empty', 'text.txt'])
def test_what_is_no_bag_is_refused(tmp_path, name) -> None:
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'text.txt').write_text('no bag')
    with pytest.raises(InputError, match='not a bag.*give a rosbag2 folder'):
        repair(tmp_path / name)


@pytest.mark.parametrize('suffix', ['.mcap', '.db3'])
def test_what_is_something_else_is_not_touched(tmp_path, suffix) -> None:
    file = tmp_path / f'x{suffix}'
    file.write_bytes(b'\x89PNG\r\n\x1a\n' + bytes(9000))
    before = files_below(tmp_path)
    with pytest.raises(InputError, match='it stays as it is'):
        repair(file)
    assert files_below(tmp_path) == before


@pytest.mark.parametrize('alone', [True, False])
def test_a_damaged_database_stays_and_the_tool_for_it_is_named(tmp_path, alone) -> None:
    bag = shutil.copytree(RECORDED / 'sqlite3', tmp_path / 'sqlite3')
    file = bag / 'sqlite3_0.db3'
    cut(file, 0.7)
    before = files_below(bag)
    with pytest.raises(InputError, match='try "sqlite3 sqlite3_0.db3 .recover | sqlite3 NEW.db3"'):
        repair(file if alone else bag)
    assert files_below(bag) == before


def test_what_is_in_the_log_of_a_database_is_not_passed_over(tmp_path) -> None:
    file = Path(shutil.copy(RECORDED / 'sqlite3/sqlite3_0.db3', tmp_path / 'a.db3'))
    with closing(sqlite3.connect(file)) as db:
        db.execute('PRAGMA journal_mode = WAL')
        db.execute('UPDATE messages SET timestamp = timestamp + 1')
        db.commit()
        for read in (repair, Bag):
            with pytest.raises(InputError, match=r'a.db3-wal; .* "sqlite3 a.db3 .PRAGMA wal_ch'):
                read(file)


@contextmanager
def as_nobody() -> Iterator[None]:
    """Be a user without rights to anything, where the tests run as root."""
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)


@pytest.mark.parametrize('whole', [True, False])
def test_a_folder_that_cannot_be_written_to(whole) -> None:
    with TemporaryDirectory() as name:  # that of pytest is closed to others
        folder = Path(name)
        file = write_mixed(folder / 'a.mcap')
        if not whole:
            cut(file)
        folder.chmod(0o555)
        before = files_below(folder)
        with as_nobody():
            if whole:
                assert repair(file).messages == 120
            else:
                with pytest.raises(InputError, match='cannot be repaired: Permission denied'):
                    repair(file)
        folder.chmod(0o755)
        assert files_below(folder) == before


def test_nothing_is_touched_where_the_disk_is_full(tmp_path) -> None:
    bag = recorded(tmp_path)
    cut(bag / 'bag_0.mcap')
    before = files_below(bag)
    with files_of_at_most(100), pytest.raises(InputError, match='be repaired: File too large'):
        repair(bag)
    assert files_below(bag) == before


REPAIR = 'import sys, pathlib; from visual_servo_epipolar.bags.repair import repair; repair({})'


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGKILL])
def test_interrupted_in_its_middle_it_is_done_anew(tmp_path, number) -> None:
    many = [('/words', TEXT, at + 5, words(f'{at:010000}')) for at in range(6000)]
    file = write_mixed(tmp_path / 'a.mcap', many, chunk_size=10**6)
    left = cut(file, 0.999)
    code = REPAIR.format('pathlib.Path(sys.argv[1])')
    process = subprocess.Popen([sys.executable, '-c', code, str(file)], stderr=subprocess.PIPE)
    partial = tmp_path / '.a.repaired.mcap.partial'
    until(lambda: partial.exists() and partial.stat().st_size > 0, 'the new file', 60.0)
    process.send_signal(number)
    process.communicate(timeout=60)
    assert process.returncode != 0
    assert not (tmp_path / 'a.repaired.mcap').exists()
    assert repair(file).messages > 7000
    assert sorted(path.name for path in tmp_path.iterdir()) == ['a.mcap', 'a.repaired.mcap']
    assert file.read_bytes() == left
