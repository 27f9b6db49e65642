"""Faults of clocks, and orders as faults: any service and parameter at any moment."""

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from functools import partial
import math
from typing import Any

import numpy as np
from std_msgs.msg import Bool

from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import range_of, Settings
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    always,
    at_first,
    Fault,
    Faults,
    Prepare,
    Strike,
    striking,
    StruckRun,
    world_change,
)
from visual_servo_epipolar.evaluation.faults.catalogue.streams import lost
from visual_servo_epipolar.evaluation.live.wire import Envelope, HOP_NS
from visual_servo_epipolar.evaluation.live.world import WorldSettings
from visual_servo_epipolar.messages import write

CLOCK, RATE = '/clock', 50


@striking
def _leap(scene: StruckRun, low: float, high: float) -> None:
    """Set the wall clock, as NTP does."""
    seconds = scene.draw(low, high)
    scene.notes.append(f'by {seconds:+.1f} s')
    scene.world.wire.offset_ns += round(seconds * NANOSECONDS)


def _tick(scene: StruckRun, goes_on: Callable[[], bool] = lambda: True) -> None:
    """Publish /clock, of the wall clock, now and as long as it ``goes_on``."""
    wire = scene.world.wire
    wire.post(Envelope(CLOCK, write.clock(wire.wall_ns), 0))
    if goes_on():
        wire.at(wire.now_ns + NANOSECONDS // RATE, lambda: _tick(scene, goes_on))


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
    _tick(scene, lambda: wire.now_ns < end_ns)
    scene.later(seconds, lambda: None)


SIMULATED = world_change(simulated_time=True)
CLOCKS: Faults = {
    'clock_forward': always('the wall clock leaps 1 to 300 s ahead', _leap(1.0, 300.0)),
    'clock_back': always('the wall clock leaps 0.1 to 900 s back', _leap(-900.0, -0.1)),
    'clock_stops': always('/clock stands still', lost(CLOCK, 0.5, 10.0), SIMULATED),
    'clock_freezes': at_first(
        'the /clock of the servo stands still, and images go on',
        _freeze,
        world_change(more={'servo_node': {'use_sim_time': True}}),
    ),
    'clock_restarts': always('/clock begins anew', _restart, SIMULATED),
}

SERVICES = (
    '/servo_node/start',
    '/servo_node/stop',
    '/servo_node/reset',
    '/tracker_node/capture_desired',
    '/tracker_node/redetect',
)
# A person who changes these says what counts as arrived, or as seen.
MEANT = ('arrival_', 'near_parallax', 'max_attempts', 'stale_timeout', 'law', 'final_turn')
ORDERS_IN_A_STORM = 30
BUTTON, PHOTOGRAPH = '/stop_button', '/desired/image_raw'
PRESSED_S = 8.0
LATER_S = 60.0  # when what was missing comes


def call(scene: StruckRun, service: str) -> None:
    """Call ``service``, and note what that means for the goal, or for a robot that moves."""
    record, witness = scene.witness.record, scene.witness
    if service.endswith('/capture_desired'):
        record.interventions.goals.append(witness.seen_pose)
    if service == '/servo_node/stop':
        scene.note_stop()
    answer = scene.world.call(service)
    if service == '/servo_node/start' and answer.startswith(('started', 'armed')):
        record.interventions.stopped_s = math.inf
    scene.notes.append(f'{service}: {answer}')


def _stop_then_start(scene: StruckRun) -> None:
    call(scene, '/servo_node/stop')
    scene.later(scene.draw(0.2, 3.0), lambda: call(scene, '/servo_node/start'))


def _storm(scene: StruckRun) -> None:
    """Call services at random, ending with a stop: nothing but the stop counts then."""
    for number in range(ORDERS_IN_A_STORM):
        service = SERVICES[int(scene.rng.integers(len(SERVICES)))]
        scene.later(0.1 * number, partial(call, scene, service))
    scene.later(0.1 * ORDERS_IN_A_STORM, lambda: call(scene, '/servo_node/stop'))


def _press(scene: StruckRun) -> None:
    """Press the stop button for a while; released, it leaves the robot standing."""
    _button(scene, pressed=True)
    scene.note_stop()
    scene.later(scene.draw(0.05, 5.0), partial(_button, scene, pressed=False))


def _button(scene: StruckRun, *, pressed: bool) -> None:
    scene.world.wire.post(Envelope(BUTTON, Bool(data=pressed), HOP_NS))


def _two_buttons(scene: StruckRun) -> None:
    """Press one stop button while a second one says all the time that it is not pressed."""
    press, other = (scene.world.talker(name, Bool, BUTTON) for name in ('button', 'second_button'))
    scene.note_stop()
    for number in range(round(2 * PRESSED_S)):
        scene.later(0.5 * number, partial(press, Bool(data=True)))
        scene.later(0.5 * number + 0.1, partial(other, Bool(data=False)))
    scene.later(scene.draw(1.0, PRESSED_S), partial(_unheard_start, scene))


def _unheard_start(scene: StruckRun) -> None:
    """Call ``~/start`` where nothing may follow from it."""
    scene.notes.append(f'start: {scene.world.call(SERVICES[0])}')


@striking
def _started_too_early(scene: StruckRun, missing: str) -> None:
    """Order to start while something is ``missing`` that comes a minute later: a node of ours."""
    scene.world.kill(missing)
    scene.later(1.0, partial(_unheard_start, scene))
    scene.note_stop()
    scene.later(LATER_S, partial(scene.world.restart, missing))


def _started_without_photograph(scene: StruckRun) -> None:
    """Order to start before there is a photograph, which comes a minute later."""
    wire = scene.world.wire
    scene.lose(PHOTOGRAPH, LATER_S)
    for name in ('camera_node', 'tracker_node'):
        scene.world.kill(name)
    wire.forget(PHOTOGRAPH)
    for name in ('tracker_node', 'camera_node'):  # once what is under way has arrived nowhere
        scene.later(0.1, partial(scene.world.start, name))
    scene.later(2.0, partial(_unheard_start, scene))
    scene.note_stop()
    scene.later(LATER_S + 0.1, partial(scene.world.restart, 'camera_node'))


def _started_without_clock(scene: StruckRun) -> None:
    """Order to start a servo of simulated time, of which /clock comes a minute later."""
    scene.later(2.0, partial(_unheard_start, scene))
    scene.note_stop()
    scene.later(LATER_S, partial(_tick, scene))


def _waits(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    return replace(settings, servo=replace(settings.servo, autostart=False))


def _waits_without_clock(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    return replace(_waits(settings, rng), more={'servo_node': {'use_sim_time': True}})


def _arming(what: str, strike: Strike, prepare: Prepare = _waits) -> Fault:
    return at_first(f'~/start, and a minute later {what}', strike, prepare)


def _carry(scene: StruckRun) -> None:
    """Carry the robot back to the start, as ``~/reset`` of the base does."""
    scene.witness.record.interventions.moved_s.append(scene.witness.now_s)
    scene.notes.append(scene.world.call('/unicycle_node/reset'))


def _limits(scene: StruckRun) -> None:
    values = {'max_linear': scene.draw(0.02, 0.1), 'max_angular': scene.draw(0.02, 0.1)}
    scene.notes.append(str(values) + scene.world.set('servo_node', values))


@striking
def _parameters(scene: StruckRun, node: str, settings: Settings) -> None:
    """Set some parameters of ``node`` to anything that they may be, one by one."""
    names = [
        item
        for item in fields(settings)
        if not range_of(item).read_only and not item.name.startswith(MEANT)
    ]

    def set_now(values: Mapping[str, Any]) -> None:
        refusal = scene.world.set(node, values)
        scene.notes.append(f'{values}{": " if refusal else ""}{refusal}')

    for number in range(int(scene.rng.integers(1, 4))):
        item = names[int(scene.rng.integers(len(names)))]
        values = {item.name: _drawn(item, getattr(settings, item.name), scene)}
        scene.later(0.5 * number, partial(set_now, values))


def _drawn(item: Any, now: Any, scene: StruckRun) -> Any:
    allowed = range_of(item)
    if isinstance(now, bool):
        return not now
    if allowed.choices:
        return str(scene.rng.choice(list(allowed.choices)))
    if not isinstance(now, (int, float)):
        return now
    factor = math.exp(scene.draw(-2.0, 2.0))
    low = -math.inf if allowed.low is None else allowed.low
    high = math.inf if allowed.high is None else allowed.high
    value = min(max(now * factor, low), high)
    return round(value) if isinstance(now, int) else float(value)


ORDERS: Faults = {
    **{
        f'order_{path.rsplit("/", 1)[1].removesuffix("_desired")}': always(
            f'~/{path.rsplit("/", 1)[1]}', partial(call, service=path)
        )
        for path in SERVICES
    },
    'order_stop_and_start': always('~/stop, and ~/start a little later', _stop_then_start),
    'order_storm': always('30 services in 3 s, then ~/stop', _storm),
    'order_button': always('the stop button is pressed, and released', _press),
    'order_two_buttons': always('one of two stop buttons is pressed', _two_buttons),
    'arming_camera': _arming('the camera comes', _started_too_early('camera_node')),
    'arming_tracker': _arming('the tracker comes', _started_too_early('tracker_node')),
    'arming_photograph': _arming('a photograph comes', _started_without_photograph),
    'arming_clock': _arming('/clock comes', _started_without_clock, _waits_without_clock),
    'carried': always('somebody carries the robot', _carry),
    'limits_lowered': Fault('max_linear, max_angular lowered', _limits),
    'parameters_servo': Fault(
        'parameters of the servo', _parameters('servo_node', ServoSettings())
    ),
    'parameters_tracker': Fault(
        'parameters of the tracker', _parameters('tracker_node', TrackerSettings())
    ),
}
