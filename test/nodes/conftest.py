"""A small camera in the room, and what it sees; a clock set by hand; room for processes."""

from collections.abc import Iterator
from contextlib import ExitStack

import pytest
from small_cameras import SMALL

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.nodes import steady
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings


class HandSetClock:
    """A steady clock that is set by hand."""

    def __init__(self) -> None:
        self.now_ns = steady.now_ns()

    def go_on(self, seconds: float) -> None:
        self.now_ns += round(seconds * 1e9)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> HandSetClock:
    """Return the steady clock of the nodes, which stands from now on."""
    hand = HandSetClock()
    monkeypatch.setattr(steady, 'now_ns', lambda: hand.now_ns)
    return hand


@pytest.fixture
def stack(monkeypatch: pytest.MonkeyPatch) -> Iterator[ExitStack]:
    """Yield what ends processes and benches, which hear each other on this machine alone."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    with ExitStack() as entered:
        yield entered


@pytest.fixture(scope='session')
def simulator() -> CameraSimulator:
    return CameraSimulator(CameraSettings(**SMALL))


@pytest.fixture(scope='session')
def photograph(simulator):
    """Return what is seen from the goal."""
    return simulator.photograph()


@pytest.fixture(scope='session')
def view(simulator):
    """Return what is seen from behind the goal."""
    return simulator.capture(Pose.from_start(0.3, -2.2, 0.0), 0)
