"""Workers of an existing Dask cluster."""

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.sweeping.provenance import digest

CONNECT_S = 10.0
NO_DASK = 'Dask cannot be imported ({}); pip install "visual_servo_epipolar[dask]"'


@contextmanager
def cluster_workers(address: str) -> Iterator[tuple[Executor, int]]:
    """
    Yield an executor on the cluster whose scheduler is at ``address``, and its number of threads.

    Raises
    ------
    InputError
        If Dask is not installed, no scheduler answers, there are no workers, or they lack this
        package or have another version of it.

    """
    client = _client(address)
    try:
        _check(client, address)
        yield client.get_executor(pure=False), sum(client.nthreads().values())
    finally:
        client.close()


def _client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError(NO_DASK.format(error)) from None
    try:
        return Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(
            f'no Dask scheduler answers at {address!r} within {CONNECT_S:g} s '
            f'({_first_line(error)}); start one with "dask scheduler", and workers with '
            f'"dask worker {address}"'
        ) from None


def _check(client: Any, address: str) -> None:
    """Ask each worker for the digest of its code, by a function that any worker can load."""

    def code() -> str:
        from visual_servo_epipolar.sweeping.provenance import digest

        return digest()

    try:
        client.wait_for_workers(1, timeout=CONNECT_S)
    except TimeoutError:
        raise InputError(
            f'the Dask scheduler at {address} has no workers; start some with '
            f'"dask worker {address}"'
        ) from None
    for worker, found in client.run(code, on_error='return').items():
        if isinstance(found, Exception):
            raise InputError(
                f'Dask worker {worker} cannot import visual_servo_epipolar '
                f'({_first_line(found)}); install this version of it there'
            )
        if found != digest():
            raise InputError(
                f'Dask worker {worker} has other code of visual_servo_epipolar ({found} there, '
                f'{digest()} here); install this version of it there and restart the worker'
            )


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]
