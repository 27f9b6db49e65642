"""Repair: what is whole in a bag that was left open, or is damaged, can be read; nothing goes."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import shutil
import signal
import sqlite3
import subprocess
import sys
from tempfile import TemporaryDirectory

from bag_reading import files_of_at_most, read_back, recorded, STORE, TEXT, until, words
from mcap.reader import make_reader
from mcap.writer import CompressionType
from mixed_mcap import chunk_offsets, content, without_index, write_mixed
import pytest
from rosbags.highlevel import AnyReader
import yaml

from visual_servo_epipolar.bags.metadata import qos_profiles
from visual_servo_epipolar.bags.repair import repair
from visual_servo_epipolar.core.errors import InputError

RECORDED = Path(__file__).parent / 'recorded'
COMPRESSIONS = list(CompressionType)


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


def information(bag: Path) -> dict:
    return yaml.safe_load((bag / 'metadata.yaml').read_text())['rosbag2_bagfile_information']


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_a_whole_bag_stays_as_it_is(tmp_path, compression) -> None:
    bag = recorded(tmp_path, compression=compression)
    before = files_below(bag)
    assert str(repair(bag)) == f'{bag}: 100 messages in 3 files; all whole'
    assert files_below(bag) == before


@pytest.mark.parametrize('kind', ['recorded', 'mcap', 'zstd', 'sqlite3'])
@pytest.mark.parametrize('text', [None, '', '{', '3', 'rosbag2_bagfile_information: {version: 9}'])
def test_metadata_that_is_missing_or_broken_is_written_as_it_was(tmp_path, kind, text) -> None:
    if kind == 'recorded':
        bag = recorded(tmp_path)
    else:
        bag = shutil.copytree(RECORDED / kind, tmp_path / kind)
    file, before, sent = bag / 'metadata.yaml', information(bag), read_back(bag)
    file.unlink()
    if text is not None:
        file.write_text(text)
    files = len(before['files'])
    assert str(repair(bag)) == (
        f'{bag}: {len(sent)} messages in {files} files; all whole; metadata.yaml written'
    )
    assert information(bag) == before
    assert read_back(bag) == sent
    kept = bag / 'metadata.yaml.damaged'
    assert (kept.read_text() if kept.exists() else '') == (text or '')


@pytest.mark.parametrize('compression', ['none', 'zstd'])
def test_of_a_file_cut_off_what_is_whole_is_written_beside_it(tmp_path, compression) -> None:
    bag = recorded(tmp_path, compression=compression)
    sent = read_back(bag)
    (bag / 'metadata.yaml').unlink()
    left = cut(bag / 'bag_2.mcap', 0.2)
    before = files_below(bag)
    report = repair(bag)
    stored = read_back(bag)
    assert stored == sent[: len(stored)]
    assert 80 <= len(stored) == report.messages < 100
    assert f'; bag_2.repaired.mcap holds {len(stored) - 80} messages of bag_2.mcap, which is ' in (
        str(report)
    )
    assert f'of {len(left)} (it ends at byte {len(left)}' in str(report)
    assert 'what lies behind is lost; metadata.yaml written' in str(report)
    after = files_below(bag)
    assert after.keys() - before.keys() == {'bag_2.repaired.mcap', 'metadata.yaml'}
    assert after.items() >= before.items()
    assert information(bag)['relative_file_paths'][2] == 'bag_2.repaired.mcap'
    assert 'all whole' in str(repair(bag))
    (bag / 'metadata.yaml').unlink()  # a copy of a damaged file never counts twice
    assert repair(bag).messages == report.messages
    assert files_below(bag) == after


@pytest.mark.parametrize('metadata', ['whole', 'broken', 'missing'])
@pytest.mark.parametrize('lost', [0, 1])
def test_a_lost_file_is_named_and_the_others_are_read(tmp_path, lost, metadata) -> None:
    bag = recorded(tmp_path)
    sent = read_back(bag)
    (bag / f'bag_{lost}.mcap').unlink()
    if metadata == 'broken':
        (bag / 'metadata.yaml').write_text('{')
    if metadata == 'missing':
        (bag / 'metadata.yaml').unlink()
    assert str(repair(bag)).endswith(
        f': 60 messages in 2 files; all whole; metadata.yaml written; lost: bag_{lost}.mcap'
    )
    assert read_back(bag) == sent[: 40 * lost] + sent[40 * lost + 40 :]
    assert repair(bag).lost == ()  # it is a bag of two files now


def test_the_last_file_is_missed_where_metadata_lists_it(tmp_path) -> None:
    bag = recorded(tmp_path)
    (bag / 'bag_2.mcap').unlink()
    assert repair(bag).lost == ('bag_2.mcap',)
    assert len(read_back(bag)) == 80


@pytest.mark.parametrize('part', [0.99, 0.5, 0.1, 0.001])
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


def test_definitions_hash_and_qos_survive(tmp_path) -> None:
    bag = recorded(tmp_path)
    with AnyReader([bag]) as reader:
        (before,) = reader.connections
    cut(bag / 'bag_2.mcap', 0.99)
    repair(bag)
    with AnyReader([bag]) as reader:
        (after,) = reader.connections
    assert after._replace(owner=None, msgcount=100) == before._replace(owner=None)
    assert after.digest == STORE.hash_rihs01(TEXT)


def test_qos_of_earlier_distributions_is_written_in_words() -> None:
    text = '- {history: 1, depth: 5, reliability: 2, durability: 1, deadline: {sec: 0, nsec: 1}}'
    (profile,) = qos_profiles(text)
    assert (profile['history'], profile['depth']) == ('keep_last', 5)
    assert (profile['reliability'], profile['durability']) == ('best_effort', 'transient_local')
    assert qos_profiles('- {history: 77}') == qos_profiles('3') == qos_profiles('{') == ()


@pytest.mark.parametrize('compression', COMPRESSIONS)
@pytest.mark.parametrize('number', [0, 3, -1])
def test_behind_a_damaged_chunk_all_is_lost_and_is_said_so(tmp_path, compression, number) -> None:
    file = write_mixed(tmp_path / 'a.mcap', compression=compression)
    whole = content(file)['messages']
    data = bytearray(file.read_bytes())
    at = chunk_offsets(file)[number]
    data[at + 120] ^= 0xFF
    file.write_bytes(data)
    report = repair(file)
    assert content(report.path)['messages'] == whole[: report.messages]
    assert report.messages < 120
    assert f'holds {report.messages} of 120 messages of a.mcap, which is damaged at byte' in (
        str(report)
    )
    assert str(report).endswith(': what lies behind is lost')
    assert file.read_bytes() == data


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_cut_at_any_byte_all_that_is_whole_before_is_kept(tmp_path, compression) -> None:
    data = write_mixed(tmp_path / 'whole.mcap', compression=compression).read_bytes()
    whole = content(tmp_path / 'whole.mcap')['messages']
    kept_before = 0
    some, last = range(9, len(data), len(data) // 40), range(len(data) - 40, len(data))
    for size in sorted({*some, *last}):
        file = tmp_path / f'{size}.mcap'
        file.write_bytes(data[:size])
        report = repair(file)
        assert report.path.name == f'{size}.repaired.mcap'
        left = content(report.path)['messages']
        assert left == whole[: len(left)], size
        assert report.messages == len(left) >= kept_before
        kept_before = len(left)
    assert kept_before == 120


@pytest.mark.parametrize('profile', ['ros2', 'ros1', 'x-own'])
def test_files_of_any_profile_and_encoding_are_repaired(tmp_path, profile) -> None:
    file = write_mixed(tmp_path / 'a.mcap', profile=profile)
    whole = content(file)
    assert 'all whole' in str(repair(file))
    cut(file, 0.99)
    left = content(repair(file).path)
    assert left['messages'] == whole['messages']
    assert left['header'].profile == profile


def test_a_file_without_index_stays_for_it_can_be_read(tmp_path) -> None:
    file = without_index(tmp_path / 'a.mcap')
    before = files_below(tmp_path)
    assert str(repair(file)) == f'{file}: 120 messages in 1 files; all whole'
    assert files_below(tmp_path) == before


def test_a_file_whose_index_alone_is_damaged_loses_nothing(tmp_path) -> None:
    file = write_mixed(tmp_path / 'a.mcap')
    with file.open('rb') as stream:
        statistics = make_reader(stream).get_summary().statistics
    data = file.read_bytes()
    count, wrong = (number.to_bytes(8, 'little') for number in (statistics.message_count, 7))
    assert data.count(count) >= 1
    at = data.rindex(b'\x0b', 0, data.rindex(count))
    per_channel = data.index((100).to_bytes(8, 'little'), at)
    file.write_bytes(data[:per_channel] + wrong + data[per_channel + 8 :])
    report = repair(file)
    assert str(report).endswith('of a.mcap, which is whole but for its index')
    assert report.messages == 120


def test_bags_in_a_folder_are_not_taken_apart(tmp_path) -> None:
    for name in ('bag_1', 'bag_2'):
        recorded(tmp_path).rename(tmp_path / name)
    # As a writer of rosbags names them: the file as its folder.
    shutil.copy(tmp_path / 'bag_1/bag_0.mcap', tmp_path / 'bag_1/bag_1.mcap')
    before = files_below(tmp_path)
    with pytest.raises(InputError, match=r'not a bag'):
        repair(tmp_path)
    assert files_below(tmp_path) == before


def test_what_the_recorder_noted_in_metadata_is_kept(tmp_path) -> None:
    bag = recorded(tmp_path)
    file = bag / 'metadata.yaml'
    noted = information(bag) | {'custom_data': {'operator': 'Ada'}, 'ros_distro': 'rolling'}
    file.write_text(yaml.safe_dump({'rosbag2_bagfile_information': noted}))
    before = file.read_bytes()
    cut(bag / 'bag_2.mcap', 0.99)
    repair(bag)
    assert (bag / 'metadata.yaml.damaged').read_bytes() == before
    assert information(bag)['custom_data'] == {'operator': 'Ada'}
    assert information(bag)['ros_distro'] == 'rolling'


@pytest.mark.parametrize('name', ['nothing', 'empty', 'text.txt'])
def test_what_is_no_bag_is_refused(tmp_path, name) -> None:
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'text.txt').write_text('no bag')
    with pytest.raises(InputError, match='not a bag.*; give a rosbag2 folder'):
        repair(tmp_path / name)


@pytest.mark.parametrize('suffix', ['.mcap', '.db3'])
@pytest.mark.parametrize(
    ('begin', 'reason'),
    [(b'\x89PNG\r\n\x1a\n', 'it stays as it is'), (b'', 'a database')],
)
def test_what_is_something_else_is_not_touched(tmp_path, suffix, begin, reason) -> None:
    file = tmp_path / f'x{suffix}'
    if begin:
        file.write_bytes(begin + bytes(9000))
    else:
        with sqlite3.connect(file) as db:
            db.execute('CREATE TABLE contacts(name TEXT)')
        db.close()
    before = files_below(tmp_path)
    with pytest.raises(InputError, match=reason):
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


LEAVE = """
import os, sqlite3, sys
db = sqlite3.connect(sys.argv[1])
db.execute('PRAGMA journal_mode = WAL')
db.execute('INSERT INTO messages(topic_id, timestamp, data) SELECT topic_id, timestamp, data FROM '
           'messages LIMIT 5')
db.commit()
os.kill(os.getpid(), 9)
"""


def test_what_is_in_the_log_of_a_database_counts(tmp_path) -> None:
    file = Path(shutil.copy(RECORDED / 'sqlite3/sqlite3_0.db3', tmp_path / 'a.db3'))
    whole = repair(file).messages
    subprocess.run([sys.executable, '-c', LEAVE, str(file)], check=False)
    before = file.read_bytes()
    assert repair(file).messages == whole + 5
    assert file.read_bytes() == before


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
    cut(bag / 'bag_2.mcap')
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
