"""The command line as its users meet it: in this process, or in one of its own."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any

import pytest

from visual_servo_epipolar.commands.main import main

ROOT = Path(__file__).parents[2]
TIMEOUT_SEC = 120.0
COMMAND = (sys.executable, '-m', 'visual_servo_epipolar')
# Of a scenario file: a small camera, for runs that are cut off.
TINY = """
camera: {width: 320, height: 240, focal_length: 192.0, principal_u: 159.5, principal_v: 119.5}
"""


def environment(*folders: Path, **more: str) -> dict[str, str]:
    """Return the environment of a process that finds modules in ``folders`` first, then ours."""
    path = [*map(str, folders), str(ROOT), os.environ.get('PYTHONPATH', '')]
    return {**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, path)), **more}


@contextmanager
def started(*arguments: str, folder: Path | None = None) -> 'Iterator[subprocess.Popen[str]]':
    """Run the command in a process of its own, in a group of its own."""
    process = subprocess.Popen(
        [*COMMAND, *arguments],
        cwd=folder,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate(timeout=TIMEOUT_SEC)


def wait_for(process: 'subprocess.Popen[str]', condition: Callable[[], bool], what: str) -> None:
    """Wait for a ``condition`` while the process goes on."""
    end = time.monotonic() + TIMEOUT_SEC
    while not condition():
        with suppress(subprocess.TimeoutExpired):
            process.wait(0.02)
            pytest.fail(f'the command ended before {what}: {process.stderr.read()}')
        if time.monotonic() > end:
            pytest.fail(f'waited {TIMEOUT_SEC:g} s for {what}')


def refusal(capsys: Any, *arguments: str) -> str:
    """Run the command, which must end with 2 and say why in one line; return that."""
    try:
        code = main(arguments)
    except SystemExit as end:
        code = end.code
    shown = capsys.readouterr()
    assert (code, shown.out, len(shown.err.splitlines())) == (2, '', 1), shown
    assert shown.err.startswith('visual_servo'), shown.err
    return str(shown.err)


def document(capsys: Any, *arguments: str, code: int = 0) -> dict[str, Any]:
    """Run the command, which must end with ``code``; return its JSON."""
    assert main([*arguments, '--json', '-']) == code
    return dict(json.loads(capsys.readouterr().out))
