"""Number of threads of libraries: to be set before they are loaded."""

import os

# Matrices here are small, and a library that shares their products waits for a core for each
# of them where others have the cores; the threads themselves keep a core busy by waiting.
ONE_THREAD = {'OPENBLAS_NUM_THREADS': '1'}


def one_thread() -> None:
    """Let numpy, which is not loaded yet, take one thread, unless the environment says more."""
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)
