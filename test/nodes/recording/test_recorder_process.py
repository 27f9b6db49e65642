"""The recorder as a process of its own: killed, interrupted, out of space."""

from collections.abc import Iterator
from contextlib import ExitStack
import itertools
import os
from pathlib import Path
import random
import signal
import subprocess
import time

from bag_reading import size_of, texts_in
from bench import Bench, next_domain
from durations import few_of
from node_process import arguments, environment, started
import pytest
from std_msgs.msg import String

from visual_servo_epipolar.bags.repair import repair
from visual_servo_epipolar.messages import write

KILLS = int(os.environ.get('RECORDER_KILLS', '2'))  # `make faults` asks for 20
START_SEC, END_SEC = 60.0, 30.0
LOSS_S = 1.0  # what a kill -9 may cost
ALL = 10_000  # messages that the publisher keeps for a recorder which the machine holds up
KINDS = ((), ('-p', 'compression:=zstd'))


class Stand:
    """A recorder in a process, and words that are published to it."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._stack, self._folder, self._domain = stack, folder, next_domain()
        self.bench = stack.enter_context(Bench(self._domain))
        self._publisher = self.bench.probe.create_publisher(String, 'words', ALL)
        self.sent: list[float] = []  # when, by number

    def record(self, bag: Path, *more: str) -> 'subprocess.Popen[bytes]':
        """Start a recorder of ``words``."""
        command = arguments('recorder_node', '-p', 'topics:=[words]', '-p', f'bag:={bag}', *more)
        log = self._folder / f'{bag.name}.log'
        process: subprocess.Popen[bytes] = started(
            self._stack, environment(self._domain), command, log
        )
        return process

    def until_heard_by(self, count: int) -> None:
        self.bench.until(
            lambda: self._publisher.get_subscription_count() >= count,
            f'{count} recorders to listen',
            START_SEC,
        )

    def say(self, text: str) -> None:
        self._publisher.publish(write.text(text))

    def say_until(self, end_s: float) -> None:
        """Publish numbers at some 200 Hz until the steady clock shows ``end_s``."""
        while time.monotonic() < end_s:
            self.sent.append(time.monotonic())
            self.say(str(len(self.sent) - 1))
            self.bench.executor.spin_once(timeout_sec=0.005)

    def output(self, bag: Path) -> str:
        return (self._folder / f'{bag.name}.log').read_text()


def sequence_numbers(bag: Path) -> list[int]:
    return [int(text[-9:]) for text in texts_in(bag)]


@pytest.fixture
def stand(stack: ExitStack, tmp_path: Path) -> Stand:
    return Stand(stack, tmp_path)


@pytest.mark.parametrize('first', range(0, KILLS, len(KINDS)))
def test_a_killed_recorder_loses_a_second_at_most(stand, tmp_path, first) -> None:
    chance = random.Random(first)
    bags = [tmp_path / f'bag{number}' for number in range(first, min(first + len(KINDS), KILLS))]
    processes = [stand.record(bag, *kind) for bag, kind in zip(bags, KINDS, strict=False)]
    stand.until_heard_by(len(bags))
    for bag, process in zip(bags, processes, strict=True):
        stand.say_until(time.monotonic() + LOSS_S + chance.uniform(0.0, 1.0))
        killed_s = time.monotonic()
        process.kill()
        process.wait(END_SEC)
        repair(bag)
        due = [item for item, sent_s in enumerate(stand.sent) if sent_s < killed_s - LOSS_S][-1]
        sequence = sequence_numbers(bag)
        assert sequence == list(range(len(sequence))), f'holes in {bag}'
        assert sequence[-1] >= due > 0, f'{due - sequence[-1]} messages too few in {bag}'


def test_an_interrupted_recorder_completes_its_bag(stand, tmp_path) -> None:
    bag = tmp_path / 'bag'
    process = stand.record(bag)
    stand.until_heard_by(1)
    stand.say_until(time.monotonic() + 0.5)
    process.send_signal(signal.SIGINT)
    assert process.wait(END_SEC) == 0, stand.output(bag)
    assert 'Traceback' not in stand.output(bag)
    sequence = sequence_numbers(bag)
    assert sequence == list(range(len(sequence)))
    assert f'{len(sequence)} messages in {bag}' in stand.output(bag)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """Yield a folder on a disk of 4 MB of its own."""
    folder = tmp_path / 'disk'
    folder.mkdir()
    command = ['mount', '-t', 'tmpfs', '-o', 'size=4m', 'none', str(folder)]
    mounted = subprocess.run(command, capture_output=True)
    if mounted.returncode:
        pytest.skip('a disk of its own can be mounted by root alone')
    yield folder
    subprocess.run(['umount', str(folder)], check=True)


@pytest.mark.parametrize('min_free', few_of([0.0, 1.0]))
def test_a_full_disk_is_one_error_and_a_bag_that_can_be_read(small_disk, stand, min_free) -> None:
    # The recorder ends before its disk is gone: fixtures end in the reverse of this order.
    bag = small_disk / 'bag'
    stand.record(bag, '-p', f'min_free:={min_free}')
    stand.until_heard_by(1)
    counter = itertools.count()

    def ended() -> bool:
        stand.say(f'{next(counter):050000}')
        return 'recording ended' in stand.output(bag)

    stand.bench.until(ended, 'the disk to be full', END_SEC)
    errors = [line for line in stand.output(bag).splitlines() if '[ERROR]' in line]
    assert len(errors) == 1, errors
    assert 'so far is whole' in errors[0]
    sequence = sequence_numbers(bag)
    assert sequence == list(range(len(sequence)))
    assert size_of(bag) > 2_000_000
