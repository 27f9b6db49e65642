"""Evaluation joins the command line by name: nothing of it loads before it is called."""

from pkgutil import resolve_name
import subprocess
import sys

import pytest

from visual_servo_epipolar.evaluation.benchmarks.command import BENCHMARKS, FOLDERS

LOADED = """
import sys
from visual_servo_epipolar.commands.main import parser
WORDS = ['simulate', '--start', '0', '-1', '0']
parser(WORDS).parse_args(WORDS)
print(*[name for name in sys.modules if name.startswith('visual_servo_epipolar.evaluation')])
"""


def test_another_command_loads_nothing_of_the_evaluation() -> None:
    ended = subprocess.run([sys.executable, '-c', LOADED], capture_output=True, text=True)
    assert (ended.returncode, ended.stdout.strip()) == (0, ''), ended.stderr


@pytest.mark.parametrize('name', BENCHMARKS)
def test_each_benchmark_is_a_row_that_runs_and_prints(name: str) -> None:
    row = resolve_name(BENCHMARKS[name])
    assert callable(row.run) and callable(row.table)
    assert set(FOLDERS) <= set(BENCHMARKS)
