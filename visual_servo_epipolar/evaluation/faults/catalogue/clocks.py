"""Faults of clocks: time that leaps, runs backwards, or stands still."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.evaluation.faults.catalogue.fault import ALWAYS, AT_FIRST, Fault, Scene
from visual_servo_epipolar.evaluation.live.wire import Envelope
from visual_servo_epipolar.evaluation.live.world import WorldSettings
from visual_servo_epipolar.messages import write

CLOCK = '/clock'


def _leap(low: float, high: float) -> Callable[[Scene], None]:
    """Set the wall clock, as NTP does."""

    def strike(scene: Scene) -> None:
        seconds = scene.draw(low, high)
        scene.notes.append(f'by {seconds:+.1f} s')
        scene.world.wire.offset_ns += round(seconds * NANOSECONDS)

    return strike


def _simulated(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    return replace(settings, simulated_time=True)


def _stop(scene: Scene) -> None:
    scene.filter(CLOCK, lambda envelope: [], scene.spell(0.5, 10.0))


def _restart(scene: Scene) -> None:
    """Let the simulation begin at 0 again."""
    begin: list[int] = []

    def again(envelope: Envelope) -> list[Envelope]:
        clock = envelope.message.clock
        now_ns = int(clock.sec) * NANOSECONDS + int(clock.nanosec)
        if not begin:
            begin.append(now_ns)
        clock.sec, clock.nanosec = divmod(now_ns - begin[0] + NANOSECONDS, NANOSECONDS)
        return [envelope]

    scene.filter(CLOCK, again)


def _freeze(scene: Scene) -> None:
    """Let the /clock of the servo alone go for a while and then stand still; images go on."""
    wire, seconds = scene.world.wire, scene.draw(2.0, 15.0)
    scene.notes.append(f'after {seconds:.1f} s')
    end_ns = wire.now_ns + round(seconds * NANOSECONDS)

    def tick() -> None:
        wire.post(Envelope(CLOCK, write.clock(wire.wall_ns), 0))
        if wire.now_ns < end_ns:
            wire.at(wire.now_ns + NANOSECONDS // 50, tick)

    tick()
    scene.later(seconds, lambda: None)


def _simulated_servo(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    return replace(settings, more={'servo_node': {'use_sim_time': True}})


FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        'clock_forward': Fault(
            what='the wall clock leaps 1 to 300 s ahead', strike=_leap(1.0, 300.0), phases=ALWAYS
        ),
        'clock_back': Fault(
            what='the wall clock leaps 0.1 to 900 s back',
            strike=_leap(-900.0, -0.1),
            phases=ALWAYS,
        ),
        'clock_stops': Fault(
            what='/clock stands still', strike=_stop, prepare=_simulated, phases=ALWAYS
        ),
        'clock_freezes': Fault(
            what='the /clock of the servo stands still, and images go on',
            strike=_freeze,
            prepare=_simulated_servo,
            phases=AT_FIRST,
        ),
        'clock_restarts': Fault(
            what='/clock begins anew', strike=_restart, prepare=_simulated, phases=ALWAYS
        ),
    }
)
