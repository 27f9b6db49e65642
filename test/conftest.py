"""What must be set before the first import of ROS; harmless where there is none."""

from collections.abc import Iterator
import os
from pathlib import Path
import shutil
import signal
import tempfile
from typing import TYPE_CHECKING

from hypothesis import settings
from hypothesis.vendor.pretty import for_type_by_name
import pytest

if TYPE_CHECKING:
    from bagmaker import Message
    from bench import Bench

LOG_DIR = Path(tempfile.mkdtemp(prefix='visual_servo_test_log_'))

# The same examples every time, and no failure because another process had the core. New ones are
# drawn by: pytest --hypothesis-profile=search
settings.register_profile('repeatable', deadline=None, max_examples=40, derandomize=True)
settings.register_profile('search', deadline=None, max_examples=1000)
settings.load_profile('repeatable')
# Hypothesis prints what a dataclass holds, class variables as well: each phase knows all others.
for kind in ('Phase', 'Event'):
    for_type_by_name(
        'visual_servo_epipolar.core.laws.phase',
        kind,
        lambda value, printer, cycle: printer.text(repr(value)),
    )

os.environ['ROS_PYTHON_CHECK_FIELDS'] = '1'  # a wrong type in a message is an error, not garbage
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'  # this process talks to itself alone
os.environ['ROS_LOG_DIR'] = str(LOG_DIR)
# A shell without a terminal lets what it starts by & ignore Ctrl-C, and so would what tests start.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_unconfigure() -> None:
    shutil.rmtree(LOG_DIR, ignore_errors=True)


@pytest.fixture(scope='session')
def small_run() -> 'list[Message]':
    """Return all that the real nodes said in five seconds of a run."""
    from bagmaker import drive, small_scenario

    scenario = small_scenario(5.0)
    return drive(scenario, scenario.loop((0.3, -2.2, 0.0), 0))


@pytest.fixture
def bench() -> 'Iterator[Bench]':
    """Yield a context of its own, with an executor and a node to listen and talk with."""
    from bench import Bench

    with Bench() as made:
        yield made
