"""Commands that are ended early: one line, nothing half written; a pipe that is not read."""

import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

from command_line import COMMAND, environment, started, TIMEOUT_SEC, TINY, wait_for
import pytest

from visual_servo_epipolar.commands import simulate
from visual_servo_epipolar.commands.main import main, terminable, Terminated
from visual_servo_epipolar.files import whole

START = ('--start', '1', '-3', '0')


@pytest.mark.parametrize(
    ('number', 'code'), [(signal.SIGTERM, 143), (signal.SIGINT, 130)], ids=['TERM', 'INT']
)
def test_a_signal_ends_a_command_in_one_line(tmp_path, monkeypatch, capsys, number, code) -> None:
    def signalled(*_: object, **__: object) -> None:
        os.kill(os.getpid(), number)
        time.sleep(TIMEOUT_SEC)  # the signal ends it

    before = [signal.getsignal(signal.SIGTERM), signal.getsignal(signal.SIGINT)]
    signal.signal(signal.SIGINT, signal.default_int_handler)  # background shells ignore it
    try:
        monkeypatch.setattr(simulate, 'drive', signalled)
        assert main(['simulate', *START, '--out', str(tmp_path / 'out')]) == code
    finally:
        signal.signal(signal.SIGINT, before[1])
    assert signal.getsignal(signal.SIGTERM) == before[0]
    assert capsys.readouterr() == ('', 'visual_servo simulate: interrupted\n')
    assert list(tmp_path.iterdir()) == []


def test_a_second_sigterm_does_not_cut_off_the_tidying_up() -> None:
    tidied = False
    with pytest.raises(Terminated), terminable():
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(TIMEOUT_SEC)
        finally:
            os.kill(os.getpid(), signal.SIGTERM)
            tidied = True
    assert tidied


def test_a_sigterm_within_a_destructor_ends_the_command_all_the_same() -> None:
    class Resource:
        def __del__(self) -> None:
            os.kill(os.getpid(), signal.SIGTERM)

    hook = sys.unraisablehook
    with pytest.raises(Terminated), terminable():
        Resource()
        time.sleep(TIMEOUT_SEC)  # the signal ends it
    with pytest.raises(Terminated), terminable():
        Resource()  # and the command ends before the signal is repeated
    assert sys.unraisablehook is hook


@pytest.mark.parametrize('number', [signal.SIGTERM, signal.SIGINT])
def test_a_signal_while_rclpy_fills_a_message_ends_the_command(request, number) -> None:
    pytest.importorskip('rclpy')
    from std_msgs.msg import String

    def signal_within(frame: Any, event: str, _: object) -> None:
        if event == 'call' and frame.f_code is String.__init__.__code__:
            sys.setprofile(None)
            os.kill(os.getpid(), number)

    bench = request.getfixturevalue('bench')
    heard = bench.listen(String, 'text')
    publisher = bench.probe.create_publisher(String, 'text', 10)
    bench.until(publisher.get_subscription_count, 'the subscription to be found')
    publisher.publish(String(data='text'))
    with pytest.raises(KeyboardInterrupt) as ended, terminable():
        sys.setprofile(signal_within)
        bench.until(lambda: heard, 'the message')
    assert ended.type is (Terminated if number == signal.SIGTERM else KeyboardInterrupt)


@pytest.mark.parametrize(
    'signalled',
    [
        pytest.param(os.kill, id='alone', marks=pytest.mark.long),
        pytest.param(os.killpg, id='with its processes'),
    ],
)
def test_a_terminated_demo_closes_its_bag_and_leaves_no_half_video(tmp_path, signalled) -> None:
    pytest.importorskip('rclpy')
    from bag_reading import read_back

    (tmp_path / 'small.yaml').write_text(TINY)
    words = ('demo', *START, '--scenario', 'small.yaml', '--out', 'out', '--bag', 'images')
    bag = tmp_path / 'out/bag'

    def holds_images() -> bool:
        return any(file.stat().st_size > 1_000_000 for file in bag.glob('bag_0.*'))

    with started(*words, folder=tmp_path) as process:
        wait_for(process, holds_images, f'messages in {bag}')
        signalled(process.pid, signal.SIGTERM)
        output, errors = process.communicate(timeout=TIMEOUT_SEC)
    assert (process.returncode, output) == (143, '')
    assert errors.splitlines()[-1] == 'visual_servo demo: interrupted'
    assert 'Traceback' not in errors
    assert [path.name for path in (tmp_path / 'out').iterdir()] == ['bag']
    assert {path.name for path in bag.iterdir()} == {'metadata.yaml', 'bag_0.mcap'}
    assert '/cmd_vel' in {topic for topic, _, _ in read_back(bag)}


@pytest.mark.parametrize(
    ('words', 'unbuffered'),
    [
        ('gains --json -', ''),
        ('gains --json -', '1'),
        ('--help', ''),
        ('gains --json r.json', '1'),
    ],
)
def test_an_unread_pipe_ends_a_command_without_a_word(tmp_path, words, unbuffered) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    ended = piped(writer, words, tmp_path, unbuffered)
    os.close(writer)
    assert (ended.returncode, ended.stderr) == (141, '')
    for path in [tmp_path / 'r.json'] * ('r.json' in words):  # before the pipe is found closed
        assert json.loads(path.read_text())['k1'] > 0.0


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='/dev/full is of Linux')
def test_output_that_cannot_be_written_is_reported_once(tmp_path) -> None:
    with open('/dev/full', 'w') as full:
        ended = piped(full.fileno(), 'gains', tmp_path)
    assert ended.returncode == 2
    assert ended.stderr == ('visual_servo: output cannot be written: No space left on device\n')


def piped(
    output: int, words: str, folder: Path, unbuffered: str = ''
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *words.split()],
        cwd=folder,
        env=environment(PYTHONUNBUFFERED=unbuffered),
        stdout=output,
        stderr=subprocess.PIPE,
        text=True,
        timeout=TIMEOUT_SEC,
    )


def test_folders_of_a_file_are_made_and_a_pipe_or_a_link_is_not_replaced(tmp_path, capsys) -> None:
    path = tmp_path / 'new/folder/result.json'  # whose folders are made once there is a result
    assert main(['gains', '--rate', '0', '--json', str(path)]) == 2
    assert list(tmp_path.iterdir()) == []
    assert main(['gains', '--json', str(path)]) == 0
    assert [file.name for file in path.parent.iterdir()] == ['result.json']
    (tmp_path / 'link').symlink_to(tmp_path / 'file')
    assert main(['gains', '--json', str(tmp_path / 'link')]) == 0
    assert (tmp_path / 'link').is_symlink()
    assert json.loads((tmp_path / 'file').read_text())['k1'] > 0.0
    os.mkfifo(tmp_path / 'pipe')
    reader = os.open(tmp_path / 'pipe', os.O_RDONLY | os.O_NONBLOCK)
    try:
        assert main(['gains', '--json', str(tmp_path / 'pipe')]) == 0
        assert json.loads(os.read(reader, 65536))['k1'] > 0.0
    finally:
        os.close(reader)


def test_a_file_is_replaced_when_the_block_ends_and_stays_if_it_raises(tmp_path: Path) -> None:
    path = tmp_path / 'told.txt'
    path.write_text('before')
    with whole(path) as partial:
        partial.write_text('after')
        assert path.read_text() == 'before'
    assert path.read_text() == 'after'
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(OSError, match='full'), whole(path) as partial:
        partial.write_text('half')
        raise OSError('the disk is full')
    assert path.read_text() == 'after'
    assert list(tmp_path.iterdir()) == [path]
