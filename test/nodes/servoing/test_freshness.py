"""How long tracks, steps and trust have been missing, on a clock that is set by hand."""

import pytest
from servo_rig import HandSetClock

from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.nodes.servoing.freshness import Freshness


@pytest.fixture
def freshness() -> Freshness:
    """Return one that begins now, by a clock set by hand."""
    made = Freshness(HandSetClock())
    made.clock = HandSetClock()
    made.clock.now_ns = made._begin_ns
    return made


def wait(freshness: Freshness, seconds: float) -> None:
    freshness.clock.now_ns += round(seconds * 1e9)


def test_tracks_and_steps_are_missed_from_the_beginning(freshness) -> None:
    wait(freshness, 3.0)
    assert (freshness.age, freshness.idle, freshness.held) == (3.0, 3.0, 0.0)


def test_new_tracks_are_no_step_and_no_trust(freshness) -> None:
    wait(freshness, 3.0)
    freshness.renew()
    wait(freshness, 0.5)
    assert (freshness.age, freshness.idle, freshness.held) == (0.5, 3.5, 0.0)


def test_a_step_is_no_new_tracks(freshness) -> None:
    wait(freshness, 3.0)
    freshness.step()
    wait(freshness, 0.5)
    assert (freshness.age, freshness.idle) == (3.5, 0.5)


def test_it_is_held_since_the_first_step_that_held_and_anew_after_another(freshness) -> None:
    for phase, held in (
        (Phase.DISPLACING, 0.0),
        (Phase.HOLDING, 1.0),
        (Phase.HOLDING, 2.0),
        (Phase.DISPLACING, 0.0),
        (Phase.HOLDING, 1.0),
    ):
        freshness.follow(phase)
        wait(freshness, 1.0)
        assert freshness.held == held
