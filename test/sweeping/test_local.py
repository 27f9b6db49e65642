"""Workers on this machine: what they are started with."""

import os

from visual_servo_epipolar.sweeping.local import MEMORY, THREADS, worker_pool


def test_workers_have_one_thread_and_keep_their_memory_and_nobody_else_does() -> None:
    before = dict(os.environ)
    with worker_pool(1, 'try again') as pool:
        told = {name: pool.submit(os.getenv, name).result() for name in (*THREADS, *MEMORY)}
    assert told == {**dict.fromkeys(THREADS, '1'), **MEMORY}
    assert dict(os.environ) == before
