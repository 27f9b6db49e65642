"""Repair: whatever is whole in a bag that was left open, or is damaged, can be read again."""

from pathlib import Path

from bag_reading import files_of_at_most, read_back, recorded, STORE, TEXT, WORDS, words
from mcap.reader import make_reader
import pytest
from rosbags.highlevel import AnyReader
import yaml

from visual_servo_epipolar.bags.repair import repair
from visual_servo_epipolar.bags.storage import Part
from visual_servo_epipolar.core.errors import InputError

EVERY_KIND = [
    pytest.param(storage, compression, id=f'{storage}-{compression}')
    for storage in ('mcap', 'sqlite3')
    for compression in ('none', 'zstd')
]


def recorded_bag(folder: Path, **settings: object) -> tuple[Path, list]:
    """Make a bag of three files, and return it with its messages."""
    bag = recorded(folder, **settings)
    return bag, read_back(bag)


def storage_file(bag: Path, number: int) -> Path:
    return next(bag.glob(f'bag_{number}.*'))


def left_open(bag: Path) -> None:
    """Bring a bag into the state in which a crash leaves it."""
    (bag / 'metadata.yaml').unlink()
    last = storage_file(bag, 2)
    (bag / last.stem).mkdir()
    last.rename(bag / last.stem / last.name)


@pytest.mark.parametrize(('storage', 'compression'), EVERY_KIND)
def test_a_whole_bag_stays_as_it_is(tmp_path, storage, compression) -> None:
    bag, sent = recorded_bag(tmp_path, storage=storage, compression=compression)
    before = {path: path.read_bytes() for path in bag.iterdir()}
    report = repair(bag)
    assert (report.messages, report.files, report.rewritten) == (100, 3, ())
    assert str(report) == f'{bag}: 100 messages in 3 files, all whole'
    assert {path: path.read_bytes() for path in bag.iterdir()} == before


@pytest.mark.parametrize(('storage', 'compression'), EVERY_KIND)
def test_metadata_is_completed_as_it_was(tmp_path, storage, compression) -> None:
    bag, sent = recorded_bag(tmp_path, storage=storage, compression=compression)
    before = yaml.safe_load((bag / 'metadata.yaml').read_text())
    left_open(bag)
    assert (
        str(repair(bag)) == f'{bag}: 100 messages in 3 files, all whole, metadata.yaml completed'
    )
    assert yaml.safe_load((bag / 'metadata.yaml').read_text()) == before
    assert read_back(bag) == sent


@pytest.mark.parametrize(('storage', 'compression'), EVERY_KIND)
def test_a_file_that_was_cut_off_keeps_what_is_whole(tmp_path, storage, compression) -> None:
    bag, sent = recorded_bag(tmp_path, storage=storage, compression=compression)
    left_open(bag)
    file = bag / 'bag_2' / f'bag_2{".mcap" if storage == "mcap" else ".db3"}'
    data = file.read_bytes()
    file.write_bytes(data[: len(data) * 9 // 10])
    report = repair(bag)
    assert report.rewritten == (file.name,)
    stored = read_back(bag)
    assert stored == sent[: len(stored)]
    assert 80 <= len(stored) == report.messages
    assert {path.suffix for path in bag.iterdir()} == {'.yaml', file.suffix, '.damaged'}
    assert (bag / f'{file.name}.damaged').read_bytes() == data[: len(data) * 9 // 10]


@pytest.mark.parametrize('text', ['', 'rosbag2_bagfile_information: {version: 9}', '{', '3'])
@pytest.mark.parametrize(('storage', 'compression'), EVERY_KIND)
def test_metadata_that_is_broken_is_written_anew(tmp_path, storage, compression, text) -> None:
    bag, sent = recorded_bag(tmp_path, storage=storage, compression=compression)
    before = (bag / 'metadata.yaml').read_text()
    (bag / 'metadata.yaml').write_text(text)
    said = f'{bag}: 100 messages in 3 files, all whole, metadata.yaml completed'
    kept = '; what was there before is kept: metadata.yaml.damaged' if text else ''
    assert str(repair(bag)) == said + kept
    assert (bag / 'metadata.yaml').read_text() == before
    assert read_back(bag) == sent


@pytest.mark.parametrize('metadata', ['whole', 'broken', 'missing'])
@pytest.mark.parametrize('lost', [0, 1])
@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_lost_file_is_named_and_the_others_are_read(tmp_path, storage, lost, metadata) -> None:
    bag, sent = recorded_bag(tmp_path, storage=storage)
    file = storage_file(bag, lost)
    file.unlink()
    if metadata == 'broken':
        (bag / 'metadata.yaml').write_text('{')
    if metadata == 'missing':
        (bag / 'metadata.yaml').unlink()
    report = repair(bag)
    assert report.lost == (file.name,)
    kept = (
        '' if metadata == 'missing' else '; what was there before is kept: metadata.yaml.damaged'
    )
    assert str(report).endswith(
        f': 60 messages in 2 files, all whole, metadata.yaml completed{kept}; lost: {file.name}'
    )
    assert read_back(bag) == sent[: 40 * lost] + sent[40 * lost + 40 :]
    assert repair(bag).lost == ()  # it is a bag of two files now


def test_the_last_file_is_missed_where_metadata_lists_it(tmp_path) -> None:
    bag, sent = recorded_bag(tmp_path)
    storage_file(bag, 2).unlink()
    assert repair(bag).lost == ('bag_2.mcap',)
    assert read_back(bag) == sent[:80]


@pytest.mark.parametrize('cut', [0.0, 0.1, 0.5, 0.99])
def test_a_single_file_is_repaired_and_indexed(tmp_path, cut) -> None:
    bag, sent = recorded_bag(tmp_path)
    file = tmp_path / 'alone.mcap'
    data = storage_file(bag, 0).read_bytes()
    file.write_bytes(data[: len(data) - 1 - int(cut * len(data))])
    report = repair(file)
    assert report.rewritten == ('alone.mcap',)
    assert read_back(file) == sent[: report.messages]
    with file.open('rb') as stream:
        assert make_reader(stream).get_summary() is not None


def test_a_file_without_index_gets_one(tmp_path) -> None:
    part = Part(tmp_path, 0, storage='mcap', compression='none')
    part.add(WORDS)
    part.write(WORDS.name, 5, words('flushed'))
    part.flush()
    part.write(WORDS.name, 6, words('not flushed'))
    part.abandon()
    file = next(tmp_path.glob('*.mcap'))
    assert read_back(file) == [(WORDS.name, 5, words('flushed'))]
    assert repair(file).rewritten == (file.name,)
    assert read_back(file) == [(WORDS.name, 5, words('flushed'))]


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('sourced', ['', 'kilted'])
def test_a_bag_names_the_distribution_of_ros(tmp_path, monkeypatch, storage, sourced) -> None:
    monkeypatch.setenv('ROS_DISTRO', sourced)
    distro = sourced or 'jazzy'
    bag, _ = recorded_bag(tmp_path, storage=storage)
    described = yaml.safe_load((bag / 'metadata.yaml').read_text())
    assert described['rosbag2_bagfile_information']['ros_distro'] == distro
    # Where a file has been taken out of its folder, it says so by itself.
    assert f'ros_distro: {distro}'.encode() in storage_file(bag, 0).read_bytes()
    file = storage_file(bag, 0)
    file.write_bytes(file.read_bytes()[:-5] if storage == 'mcap' else file.read_bytes()[:-4096])
    repair(bag)
    assert f'ros_distro: {distro}'.encode() in file.read_bytes()


def test_definitions_hash_and_qos_survive(tmp_path) -> None:
    bag, _ = recorded_bag(tmp_path)
    with AnyReader([bag]) as reader:
        (before,) = reader.connections
    left_open(bag)
    file = bag / 'bag_2/bag_2.mcap'
    file.write_bytes(file.read_bytes()[:-5])
    repair(bag)
    with AnyReader([bag]) as reader:
        (after,) = reader.connections
        texts = [reader.deserialize(data, TEXT).data for _, _, data in reader.messages()]
    assert after._replace(owner=None) == before._replace(owner=None)
    assert after.digest == STORE.hash_rihs01(TEXT)
    assert texts == [f'{number:05000}' for number in range(100)]


def test_a_chunk_that_is_damaged_is_left_out(tmp_path) -> None:
    bag, sent = recorded_bag(tmp_path, compression='zstd')
    file = storage_file(bag, 1)
    data = bytearray(file.read_bytes())
    data[data.index(b'\x28\xb5\x2f\xfd') + 20] ^= 0xFF
    file.write_bytes(data)
    report = repair(bag)
    assert report.rewritten == (file.name,)
    assert read_back(bag) == sent[:40] + sent[80:]


def test_nothing_is_touched_where_the_disk_is_full(tmp_path) -> None:
    bag, sent = recorded_bag(tmp_path)
    left_open(bag)
    file = bag / 'bag_2/bag_2.mcap'
    file.write_bytes(file.read_bytes()[:-5])
    with (
        files_of_at_most(1000),
        pytest.raises(InputError, match='cannot be repaired: File too la'),
    ):
        repair(bag)
    assert repair(bag).messages == 100
    assert read_back(bag) == sent


@pytest.mark.parametrize('name', ['nothing', 'empty', 'text.txt'])
def test_what_is_no_bag_is_refused(tmp_path, name) -> None:
    (tmp_path / 'empty').mkdir()
    (tmp_path / 'text.txt').write_text('no bag')
    with pytest.raises(InputError, match='not a bag.*; give a rosbag2 folder'):
        repair(tmp_path / name)


@pytest.mark.parametrize(
    ('suffix', 'content'),
    [
        (suffix, content)
        for suffix, magic in (('.mcap', b'\x89MCAP0\r\n'), ('.db3', b'SQLite format 3\x00'))
        for content in (b'', magic, bytes(5000))
    ],
)
def test_a_file_with_nothing_in_it_becomes_an_empty_bag(tmp_path, suffix, content) -> None:
    file = tmp_path / f'x{suffix}'
    file.write_bytes(content)
    assert repair(file).messages == 0
    assert read_back(file) == []
