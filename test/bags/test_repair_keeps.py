"""Repair loses nothing: whole files stay, every record that can be read is kept, old ones too."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import shutil
import signal
import sqlite3
import subprocess
import sys
from tempfile import TemporaryDirectory

from bag_reading import files_of_at_most, read_back, recorded, until, words
from mcap.writer import CompressionType
from mixed_mcap import chunk_offsets, content, counts_by_topic, SOME, without_index, write_mixed
import pytest
import yaml

from visual_servo_epipolar.bags.repair import repair
from visual_servo_epipolar.bags.salvaging.mcap_salvage import McapSalvage
from visual_servo_epipolar.core.errors import InputError

COMPRESSIONS = [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD]


def files_below(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob('*'))
        if path.is_file()
    }


def old_of(file: Path) -> Path:
    return file.with_name(f'{file.name}.damaged')


@pytest.mark.parametrize('compression', COMPRESSIONS)
@pytest.mark.parametrize('profile', ['ros2', 'ros1', '', 'x-own'])
@pytest.mark.parametrize('chunked', [True, False])
def test_a_whole_file_stays_byte_for_byte(tmp_path, compression, profile, chunked) -> None:
    file = write_mixed(
        tmp_path / 'a.mcap', compression=compression, profile=profile, use_chunking=chunked
    )
    before = files_below(tmp_path)
    assert str(repair(file)) == f'{file}: 120 messages in 1 files, all whole'
    assert files_below(tmp_path) == before


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_a_file_without_index_keeps_every_record(tmp_path, compression) -> None:
    whole = content(write_mixed(tmp_path / 'whole.mcap', compression=compression))
    file = without_index(tmp_path / 'a.mcap', compression=compression)
    before = file.read_bytes()
    report = repair(file)
    assert (report.messages, report.lost_bytes, report.kept) == (120, 0, ('a.mcap.damaged',))
    assert content(file) == whole
    assert old_of(file).read_bytes() == before


@pytest.mark.parametrize('compression', COMPRESSIONS)
def test_cut_at_any_byte_all_that_is_whole_before_is_kept(tmp_path, compression) -> None:
    data = write_mixed(tmp_path / 'whole.mcap', compression=compression).read_bytes()
    whole = content(tmp_path / 'whole.mcap')
    kept_before = 0
    for size in (*range(9, len(data), max(1, len(data) // 60)), *range(len(data) - 60, len(data))):
        folder = tmp_path / str(size)
        folder.mkdir(exist_ok=True)
        file = folder / 'a.mcap'
        file.write_bytes(data[:size])
        report = repair(file)
        left = content(file)
        assert old_of(file).read_bytes() == data[:size]
        in_file = [item for item in whole['messages'] if item in left['messages']]
        assert left['messages'] == in_file == whole['messages'][: len(in_file)], size
        assert report.messages == len(in_file) >= kept_before
        kept_before = len(in_file)
        assert left['attachments'] in ([], whole['attachments'])
        shutil.rmtree(folder)
    assert kept_before == 120


def test_of_the_chunk_that_a_crash_cut_off_the_whole_messages_are_kept(tmp_path) -> None:
    file = write_mixed(tmp_path / 'a.mcap', chunk_size=10**6)
    data = file.read_bytes()
    (last,) = chunk_offsets(file)[-1:]
    file.write_bytes(data[: last + (len(data) - last) // 2])
    assert repair(file).messages > 40


@pytest.mark.parametrize('compression', COMPRESSIONS)
@pytest.mark.parametrize('number', [0, 3, -1])
def test_a_damaged_chunk_costs_its_own_messages_and_they_are_counted(
    tmp_path, compression, number
) -> None:
    file = write_mixed(tmp_path / 'a.mcap', compression=compression)
    whole = counts_by_topic(file)
    data = bytearray(file.read_bytes())
    data[chunk_offsets(file)[number] + 120] ^= 0xFF
    file.write_bytes(data)
    report = repair(file)
    left = counts_by_topic(file)
    assert old_of(file).read_bytes() == data
    # The first chunk says what the channels are: the summary knows it as well.
    assert 80 <= left.total() < 120
    lost = whole - left
    assert {text.split()[0]: text for text in report.lost_messages} == {
        topic: f'{topic} {count} of {whole[topic]} messages' for topic, count in lost.items()
    }
    assert f'/words {lost["/words"]} of 100 messages' in str(report)
    assert str(report).endswith('; what was there before is kept: a.mcap.damaged')


@pytest.mark.parametrize('profile', ['ros1', '', 'x-own'])
def test_a_damaged_file_of_another_profile_is_named_and_stays(tmp_path, profile) -> None:
    file = write_mixed(tmp_path / 'a.mcap', profile=profile)
    file.write_bytes(file.read_bytes()[:-40])
    before = files_below(tmp_path)
    with pytest.raises(InputError, match=f'of profile {profile!r}, not "ros2", and stays as it'):
        repair(file)
    assert files_below(tmp_path) == before


def test_the_new_file_takes_its_place_only_if_it_holds_all(tmp_path, monkeypatch) -> None:
    file = without_index(tmp_path / 'a.mcap')
    before = files_below(tmp_path)

    def write_less(salvage: McapSalvage, target: Path) -> None:
        write_mixed(target, SOME[:90])

    monkeypatch.setattr(McapSalvage, 'write', write_less)
    with pytest.raises(InputError, match='the new file holds 110 of the 122 records'):
        repair(file)
    assert files_below(tmp_path) == before


def test_old_files_of_earlier_repairs_stay(tmp_path) -> None:
    file = without_index(tmp_path / 'a.mcap')
    repair(file)
    file.write_bytes(file.read_bytes()[:-1])
    assert repair(file).kept == ('a.mcap.1.damaged',)
    assert len(list(tmp_path.iterdir())) == 3


def test_a_link_stays_one_and_what_it_leads_to_is_repaired(tmp_path) -> None:
    (tmp_path / 'store').mkdir()
    (tmp_path / 'bag').mkdir()
    file = without_index(tmp_path / 'store/x.mcap')
    link = tmp_path / 'bag/bag_0.mcap'
    link.symlink_to(file)
    before = file.read_bytes()
    assert repair(tmp_path / 'bag').messages == 120
    assert link.is_symlink() and link.read_bytes() == file.read_bytes() != before
    assert old_of(file).read_bytes() == before


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_bags_in_a_folder_are_not_taken_apart(tmp_path, storage) -> None:
    for name in ('bag_1', 'bag_2'):
        recorded(tmp_path, storage=storage).rename(tmp_path / name)
    # As a writer of rosbags names them: the file as its folder.
    inner = next((tmp_path / 'bag_1').glob(f'bag_0.{"mcap" if storage == "mcap" else "db3"}'))
    shutil.copy(inner, tmp_path / f'bag_1/bag_1{inner.suffix}')
    before = files_below(tmp_path)
    with pytest.raises(InputError, match=r'not a bag'):
        repair(tmp_path)
    assert files_below(tmp_path) == before


def test_what_somebody_put_beside_an_unfinished_file_stays(tmp_path) -> None:
    bag = recorded(tmp_path)
    (bag / 'bag_2').mkdir()
    (bag / 'bag_2.mcap').rename(bag / 'bag_2/bag_2.mcap')
    (bag / 'bag_2/notes.txt').write_text('kitchen')
    assert repair(bag).messages == 100
    assert (bag / 'bag_2/notes.txt').read_text() == 'kitchen'
    assert len(read_back(bag)) == 100


def test_a_file_that_is_there_twice_is_not_overwritten(tmp_path) -> None:
    bag = recorded(tmp_path)
    (bag / 'bag_2').mkdir()
    shutil.copy(bag / 'bag_1.mcap', bag / 'bag_2/bag_2.mcap')
    before = files_below(bag)
    with pytest.raises(InputError, match='it has bag_2.mcap twice, here and in bag_2'):
        repair(bag)
    assert files_below(bag) == before


def test_what_the_recorder_noted_in_metadata_is_kept(tmp_path) -> None:
    bag = recorded(tmp_path)
    file = bag / 'metadata.yaml'
    noted = yaml.safe_load(file.read_text())
    noted['rosbag2_bagfile_information']['custom_data'] = {'operator': 'Ada'}
    noted['rosbag2_bagfile_information']['ros_distro'] = 'rolling'
    file.write_text(yaml.safe_dump(noted))
    before = file.read_bytes()
    (bag / 'bag_2.mcap').write_bytes((bag / 'bag_2.mcap').read_bytes()[:-7])
    report = repair(bag)
    assert report.kept == ('bag_2.mcap.damaged', 'metadata.yaml.damaged')
    assert old_of(file).read_bytes() == before
    information = yaml.safe_load(file.read_text())['rosbag2_bagfile_information']
    assert information['custom_data'] == {'operator': 'Ada'}
    assert (information['ros_distro'], information['message_count']) == ('rolling', 100)


@pytest.mark.parametrize('suffix', ['.mcap', '.db3'])
@pytest.mark.parametrize(
    ('begin', 'reason'),
    [(b'\x89PNG\r\n\x1a\n', 'a picture'), (b'PK\x03\x04', 'an archive'), (b'', 'a database')],
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


LEAVE = """
import os, sqlite3, sys
path, journal, finished = sys.argv[1:]
db = sqlite3.connect(path)
db.execute(f'PRAGMA journal_mode = {journal}')
db.execute('PRAGMA wal_autocheckpoint = 0')
db.execute('PRAGMA cache_size = 2')
db.commit()
sql = 'INSERT INTO messages(topic_id, timestamp, data) '
sql += 'SELECT 1, timestamp + ?, data FROM messages LIMIT 40'
db.execute(sql, (1000,))
db.commit()
if finished == 'no':
    db.execute(sql, (2000,))
    db.execute(sql, (3000,))
os.kill(os.getpid(), 9)
"""


def killed_database(folder: Path, journal: str, finished: str) -> Path:
    """Return a bag that sqlite3 was writing 40 messages more to as its process was killed."""
    folder.mkdir(exist_ok=True)
    bag = recorded(folder, storage='sqlite3')
    file = folder / 'a.db3'
    (bag / 'bag_0.db3').rename(file)
    subprocess.run([sys.executable, '-c', LEAVE, str(file), journal, finished], check=False)
    return file


@pytest.mark.parametrize('finished', ['yes', 'no'])
def test_what_is_in_the_log_of_a_database_is_brought_in(tmp_path, finished) -> None:
    file = killed_database(tmp_path, 'WAL', finished)
    log = file.with_name('a.db3-wal')
    before, logged = file.read_bytes(), log.read_bytes()
    assert logged
    report = repair(file)
    assert (report.messages, report.lost_bytes) == (80, 0)
    assert len(read_back(file)) == 80
    assert not log.exists()
    assert old_of(file).read_bytes() == before
    assert old_of(file).with_name('a.db3.damaged-wal').read_bytes() == logged
    with sqlite3.connect(old_of(file)) as db:  # with its log it is a database still
        assert db.execute('SELECT COUNT(*) FROM messages').fetchone() == (80,)
    db.close()


@pytest.mark.parametrize('finished', ['yes', 'no'])
def test_a_transaction_that_was_not_finished_is_rolled_back(tmp_path, finished) -> None:
    file = killed_database(tmp_path, 'DELETE', finished)
    journal = file.with_name('a.db3-journal')
    assert journal.exists() == (finished == 'no')
    report = repair(file)
    assert (report.messages, report.lost_bytes) == (80, 0)
    assert report.kept == (('a.db3.damaged',) if finished == 'no' else ())
    assert not journal.exists()
    assert len(read_back(file)) == 80


@pytest.mark.parametrize('page', [7, 12, 18, 23, 28, 38, 48, 52, 56])
def test_a_damaged_page_costs_only_the_rows_in_it(tmp_path, page) -> None:
    file = recorded(tmp_path, storage='sqlite3') / 'bag_0.db3'
    with sqlite3.connect(file) as db:
        db.execute('CREATE TABLE calibration(serial TEXT, k BLOB)')
        db.execute('INSERT INTO calibration VALUES (?, ?)', ('7', b'matrix'))
    db.close()
    data = bytearray(file.read_bytes())
    data[4096 * page : 4096 * page + 200] = b'\xff' * 200
    file.write_bytes(data)
    report = repair(file)
    assert report.messages >= 34  # a page has six
    if report.rewritten:
        assert old_of(file).read_bytes() == data
    lost = 40 - report.messages
    assert report.lost_messages == ((f'{lost} of 40 messages',) if lost else ())
    stamps = [stamp for _, stamp, _ in read_back(file)]
    assert len(stamps) == len(set(stamps)) == report.messages


@pytest.mark.parametrize('part', [0.3, 0.5, 0.7, 0.9, 0.98])
def test_a_database_that_was_cut_off_keeps_the_rows_before(tmp_path, part) -> None:
    file = recorded(tmp_path, storage='sqlite3') / 'bag_0.db3'
    whole = read_back(file)
    data = file.read_bytes()
    file.write_bytes(data[: int(part * len(data))])
    report = repair(file)
    assert read_back(file) == whole[: report.messages]
    assert report.messages >= part * len(whole) - 6  # those of a page


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
        file = write_mixed(folder / 'a.mcap') if whole else without_index(folder / 'a.mcap')
        folder.chmod(0o555)
        before = files_below(folder)
        with as_nobody():
            if whole:
                assert repair(file).messages == 120
            else:
                with pytest.raises(InputError, match='cannot be repaired: Permission denied; n'):
                    repair(file)
        folder.chmod(0o755)
        assert files_below(folder) == before


REPAIR = 'import sys, pathlib; from visual_servo_epipolar.bags.repair import repair; repair({})'


def scratch_is_filling(folder: Path) -> Callable[[], bool]:
    return lambda: any(path.stat().st_size for path in folder.glob('.repair_*/*'))


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGKILL])
def test_interrupted_in_its_middle_it_leaves_the_old_file(tmp_path, number) -> None:
    many = [('/words', 'std_msgs/msg/String', at + 5, words(f'{at:010000}')) for at in range(6000)]
    file = tmp_path / 'a.mcap'
    without_index_of(file, many)
    before = file.read_bytes()
    code = REPAIR.format('pathlib.Path(sys.argv[1])')
    process = subprocess.Popen([sys.executable, '-c', code, str(file)], stderr=subprocess.PIPE)
    until(scratch_is_filling(tmp_path), 'the new file to be written', 60.0)
    process.send_signal(number)
    process.communicate(timeout=60)
    assert process.returncode != 0
    assert file.read_bytes() == before
    if number == signal.SIGINT:
        assert [path.name for path in tmp_path.iterdir()] == ['a.mcap']
    assert repair(file).messages == 7200
    assert old_of(file).read_bytes() == before


def without_index_of(file: Path, messages: list) -> None:
    without_index(file, messages=messages, chunk_size=10**6, compression=CompressionType.ZSTD)


@pytest.mark.parametrize('number', [0, 2, -1])
@pytest.mark.parametrize('length', [b'\xff' * 8, bytes(8), b'\x20' + bytes(7)])
def test_where_records_cannot_be_followed_the_index_leads_on(tmp_path, number, length) -> None:
    file = write_mixed(tmp_path / 'a.mcap')
    data = bytearray(file.read_bytes())
    at = chunk_offsets(file)[number] + 1
    data[at : at + 8] = length
    file.write_bytes(data)
    report = repair(file)
    assert 100 <= report.messages <= 120
    assert len(content(file)['attachments']) == 1
    assert old_of(file).read_bytes() == data


@pytest.mark.parametrize('at', [0, 3, 8, 9, 20])
def test_a_damaged_beginning_costs_no_message(tmp_path, at) -> None:
    file = write_mixed(tmp_path / 'a.mcap')
    data = bytearray(file.read_bytes())
    data[at] ^= 0xFF
    file.write_bytes(data)
    assert repair(file).messages == 120
    assert old_of(file).read_bytes() == data


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3', 'log'])
def test_on_a_full_disk_everything_stays(tmp_path, storage) -> None:
    bag = recorded(tmp_path, storage='mcap' if storage == 'mcap' else 'sqlite3')
    file = next(bag.glob('bag_1.*'))
    if storage == 'log':
        shutil.move(killed_database(tmp_path / 'other', 'WAL', 'yes'), bag / 'bag_3.db3')
        shutil.move(tmp_path / 'other/a.db3-wal', bag / 'bag_3.db3-wal')
    else:
        file.write_bytes(file.read_bytes()[:-5000])
    before = files_below(tmp_path)
    with files_of_at_most(50_000), pytest.raises(InputError, match='cannot be repaired: .*; noth'):
        repair(bag)
    assert files_below(tmp_path) == before
    assert repair(bag).messages >= 98
