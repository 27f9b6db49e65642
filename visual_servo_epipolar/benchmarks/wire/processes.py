"""Processes of nodes on this machine alone, and what they cost."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, ExitStack
from dataclasses import dataclass
import os
from pathlib import Path
import subprocess
import sys
from typing import Any

from visual_servo_epipolar.nodes.startup.transport import tune_transport

# Its own among benchmarks that run at a time, and above those that people use.
DOMAIN = 216 + os.getpid() % 16
DISCOVERY = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
NODES = 'visual_servo_epipolar.nodes'

Process = subprocess.Popen[bytes]


@dataclass(frozen=True, slots=True)
class Cost:
    """Processor time [s] and resident memory [MB] of a process up to now, and its peak [MB]."""

    processor_s: float
    memory_mb: float
    peak_mb: float

    @classmethod
    def of(cls, process: Process) -> 'Cost':
        """Read what the kernel knows of a process."""
        # User and system time are fields 14 and 15; the name before them may hold blanks.
        fields = Path(f'/proc/{process.pid}/stat').read_text().rpartition(')')[2].split()
        ticks = int(fields[11]) + int(fields[12])
        status = dict(
            line.split(':', 1)
            for line in Path(f'/proc/{process.pid}/status').read_text().splitlines()
        )
        resident, peak = (int(status[key].split()[0]) * 1024 / 1e6 for key in ('VmRSS', 'VmHWM'))
        return cls(ticks / os.sysconf('SC_CLK_TCK'), resident, peak)


def started(
    stack: ExitStack, nodes: Mapping[str, Sequence[str]], folder: Path
) -> dict[str, Process]:
    """Start each node (a module's full name, or one of ours) with its arguments in ``folder``."""
    return {name: _started(stack, name, arguments, folder) for name, arguments in nodes.items()}


def costs(processes: Mapping[str, Process]) -> dict[str, Cost]:
    """Return what each process has cost up to now."""
    return {name: Cost.of(process) for name, process in processes.items()}


def spent(
    before: Mapping[str, Cost], after: Mapping[str, Cost], frames: int
) -> dict[str, dict[str, Any]]:
    """Return what ``frames`` cost each process: processor [ms a frame], memory [MB]."""
    return {
        name: {
            'processor_ms': 1e3 * (after[name].processor_s - it.processor_s) / max(frames, 1),
            'memory_mb': [it.memory_mb, after[name].memory_mb],
            'peak_mb': after[name].peak_mb,
        }
        for name, it in before.items()
    }


@contextmanager
def only_this_machine() -> Iterator[None]:
    """Let no other machine see the topics: nodes of a benchmark may publish cmd_vel."""
    tune_transport()
    before = os.environ.get(DISCOVERY)
    os.environ[DISCOVERY] = 'LOCALHOST'
    try:
        yield
    finally:
        del os.environ[DISCOVERY]
        if before is not None:
            os.environ[DISCOVERY] = before


def _started(stack: ExitStack, name: str, arguments: Sequence[str], folder: Path) -> Process:
    module = name if '.' in name else f'{NODES}.{name}'
    process = stack.enter_context(
        subprocess.Popen(
            [sys.executable, '-m', module, '--ros-args', *arguments],
            cwd=folder,
            env={**os.environ, 'ROS_DOMAIN_ID': str(DOMAIN), 'PYTHONPATH': _import_path()},
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    )
    stack.callback(process.terminate)
    return process


def _import_path() -> str:
    return os.pathsep.join(filter(None, map(os.path.abspath, sys.path)))
