"""Processes beside this one: copied where this has one thread, new ones otherwise."""

import os
import subprocess
import sys
import threading

import pytest

from visual_servo_epipolar.processes import context, cores, is_forked, THREADS
from visual_servo_epipolar.threads import ONE_THREAD

# In a process of its own: that of pytest may have threads.
DRAWN = """
import numpy as np

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.processes import context, is_forked
from visual_servo_epipolar.simulation.camera_simulator import assistant_of, CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

assert is_forked(context())
settings, poses = CameraSettings(), [Pose.from_start(0.3, -2.2, turn) for turn in (4.0, 5.0)]
simulator, helped = CameraSimulator(settings), []
alone = [simulator.capture(*it) for it in zip(poses, (0, 1))]  # OpenCV has started threads by now
with assistant_of(settings) as assistant:
    finish = assistant.finish
    assistant.finish = lambda image: helped.append(finish(image)) or helped[-1]
    simulator.renderer.assistant = assistant
    assert assistant.wait()
    assert type(assistant._process).__name__ == 'ForkProcess'
    together = [simulator.capture(*it) for it in zip(poses, (0, 1))]
assert helped == [True, True], helped
assert np.array_equal(alone, together)
"""
HEARD = """
from visual_servo_epipolar.processes import begun, context, is_forked


def listen(there):
    try:
        there.recv()
    except EOFError:
        print('closed', flush=True)


beside = context()
assert is_forked(beside)
there, here = beside.Pipe()
process = begun(beside, 'listener', listen, (there,), ours=(here,))
there.close()
here.close()
process.join(20.0)
assert process.exitcode == 0, process.exitcode
"""

STRUCK = """
import os
import signal

from visual_servo_epipolar.processes import begun, context


def tell():
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, [])
    print(signal.getsignal(signal.SIGINT).name, blocked, flush=True)


class Struck:  # a context that presses Ctrl-C while a process is started, here and there
    def __init__(self, beside):
        self.get_start_method, self._beside = beside.get_start_method, beside

    def Process(self, **given):
        process = self._beside.Process(**given)
        start = process.start
        process.start = lambda: (os.kill(os.getpid(), signal.SIGINT), start())
        os.register_at_fork(after_in_child=lambda: os.kill(os.getpid(), signal.SIGINT))
        return process


signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    begun(Struck(context()), 'teller', tell, ()).join(20.0)
    print('lost', flush=True)
except KeyboardInterrupt:
    from multiprocessing import active_children
    for process in active_children():
        process.join(20.0)
    print('heard here', flush=True)
"""

COPIED = """
import os
import signal
import sys

from visual_servo_epipolar.processes import copied, may_fork


def broken():
    raise SystemExit(0)  # whatever it is that ends the work early


assert may_fork()
ends = [copied(lambda: print('worked', flush=True)), copied(broken)]
assert [is_done() for is_done in ends] == [True, False]
there, here = os.pipe()
if os.fork() == 0:  # one that is killed while its copy works
    copied(signal.pause)
    os.kill(os.getpid(), signal.SIGKILL)
os.close(here)
os.wait()
assert os.read(there, 1) == b''  # closed by all: the copy has ended
"""

OUTLIVED = """
import os
import signal
import time

from visual_servo_epipolar.processes import begun, context, may_fork

assert may_fork()
there, here = os.pipe()
if os.fork() == 0:  # one that is killed while its process looks after nothing but its work
    begun(context(), 'worker', time.sleep, (20.0,))
    os.kill(os.getpid(), signal.SIGKILL)
os.close(here)
os.wait()
killed_s = time.monotonic()
assert os.read(there, 1) == b''  # closed by all
assert time.monotonic() - killed_s < 10.0
"""

forks = pytest.mark.skipif(not THREADS.is_dir(), reason='nothing is forked here')


def run(program: str) -> str:
    environment = {**os.environ, **ONE_THREAD}
    done = subprocess.run(
        [sys.executable, '-c', program],
        env=environment,
        timeout=120.0,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@forks
@pytest.mark.skipif(cores() < 2, reason='needs a second core')
def test_a_copy_draws_what_is_drawn_here() -> None:
    run(DRAWN)


@forks
def test_a_copy_hears_when_its_pipe_is_closed_here() -> None:
    assert run(HEARD) == 'closed\n'


@forks
def test_a_process_beside_leaves_ctrl_c_to_its_parent_from_its_first_moment() -> None:
    assert run(STRUCK) == 'SIG_IGN set()\nheard here\n'


@forks
def test_a_copy_tells_whether_its_work_was_done_and_ends_with_this_process() -> None:
    assert run(COPIED) == 'worked\n'


@forks
def test_a_process_beside_does_not_outlive_this_one_whatever_it_is_at() -> None:
    run(OUTLIVED)


def test_a_process_with_threads_is_not_copied() -> None:
    ended = threading.Event()
    other = threading.Thread(target=ended.wait)
    other.start()
    try:
        assert not is_forked(context())
    finally:
        ended.set()
        other.join()
