"""Faults of clocks: time that leaps, runs backwards, or stands still."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    always,
    at_first,
    Faults,
    Prepare,
    Strike,
    StruckRun,
)
from visual_servo_epipolar.evaluation.live.wire import Envelope
from visual_servo_epipolar.messages import write

CLOCK, RATE = '/clock', 50


def world_change(**changes: Any) -> Prepare:
    """Change how a world is built."""
    return lambda settings, rng: replace(settings, **changes)


def _leap(low: float, high: float) -> Strike:
    """Set the wall clock, as NTP does."""

    def strike(scene: StruckRun) -> None:
        seconds = scene.draw(low, high)
        scene.notes.append(f'by {seconds:+.1f} s')
        scene.world.wire.offset_ns += round(seconds * NANOSECONDS)

    return strike


def tick(scene: StruckRun, goes_on: Callable[[], bool] = lambda: True) -> None:
    """Publish /clock, of the wall clock, now and as long as it ``goes_on``."""
    wire = scene.world.wire
    wire.post(Envelope(CLOCK, write.clock(wire.wall_ns), 0))
    if goes_on():
        wire.at(wire.now_ns + NANOSECONDS // RATE, lambda: tick(scene, goes_on))


def _restart(scene: StruckRun) -> None:
    """Let the simulation begin at 0 again."""
    begin: list[int] = []

    def again(message: Any) -> None:
        clock = message.clock
        now_ns = int(clock.sec) * NANOSECONDS + int(clock.nanosec)
        begin.append(now_ns)
        clock.sec, clock.nanosec = divmod(now_ns - begin[0] + NANOSECONDS, NANOSECONDS)

    scene.alter(CLOCK, again)


def _freeze(scene: StruckRun) -> None:
    """Let the /clock of the servo alone go for a while and then stand still; images go on."""
    wire, seconds = scene.world.wire, scene.draw(1.0, 7.0)
    scene.notes.append(f'after {seconds:.1f} s')
    end_ns = wire.now_ns + round(seconds * NANOSECONDS)
    tick(scene, lambda: wire.now_ns < end_ns)
    scene.later(seconds, lambda: None)


SIMULATED = world_change(simulated_time=True)
FAULTS: Faults = {
    'clock_forward': always('the wall clock leaps 1 to 300 s ahead', _leap(1.0, 300.0)),
    'clock_back': always('the wall clock leaps 0.1 to 900 s back', _leap(-900.0, -0.1)),
    'clock_stops': always(
        '/clock stands still', lambda scene: scene.lose(CLOCK, scene.spell(0.5, 10.0)), SIMULATED
    ),
    'clock_freezes': at_first(
        'the /clock of the servo stands still, and images go on',
        _freeze,
        world_change(more={'servo_node': {'use_sim_time': True}}),
    ),
    'clock_restarts': always('/clock begins anew', _restart, SIMULATED),
}
