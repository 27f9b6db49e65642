"""Workers on this machine: what they are started with, and what does not end them."""

import os
from pathlib import Path
import signal
import subprocess
import sys

from visual_servo_epipolar.sweeping.workers import MEMORY, THREADS, worker_pool

ROOT = Path(__file__).parents[2]


def test_workers_alone_have_one_thread_and_keep_their_memory() -> None:
    before = dict(os.environ)
    with worker_pool(1, 'try again') as pool:
        told = {name: pool.submit(os.getenv, name).result() for name in (*THREADS, *MEMORY)}
    assert told == {**dict.fromkeys(THREADS, '1'), **MEMORY}
    assert dict(os.environ) == before


# Read by every Python that is started with its folder on PYTHONPATH: Ctrl-C at its first line.
STRUCK = """
import os, signal, sys
if '--multiprocessing-fork' in sys.orig_argv:
    os.kill(os.getpid(), signal.SIGINT)
"""
POOL = """
import signal
from visual_servo_epipolar.sweeping.workers import worker_pool

if __name__ == '__main__':
    with worker_pool(1, 'try again') as pool:
        print(pool.submit(signal.getsignal, signal.SIGINT).result().name)
        print(pool.submit(signal.pthread_sigmask, signal.SIG_BLOCK, []).result())
"""


def test_a_worker_that_is_still_loading_leaves_ctrl_c_to_its_parent(tmp_path: Path) -> None:
    (tmp_path / 'sitecustomize.py').write_text(STRUCK)
    (tmp_path / 'pool.py').write_text(POOL)
    path = [str(tmp_path), str(ROOT), os.environ.get('PYTHONPATH', '')]
    ended = subprocess.run(
        [sys.executable, str(tmp_path / 'pool.py')],
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, path))},
        capture_output=True,
        text=True,
        timeout=120.0,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    assert (ended.returncode, ended.stderr) == (0, '')
    assert ended.stdout.split('\n') == ['SIG_IGN', 'set()', '']
