"""
Faults of the robot: wheels, commands, nodes, encoders and clocks; orders; routes.

Any service and parameter at any moment is an order. The route node is in the place of the servo,
under its name.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, fields, replace
from functools import cache, partial
import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from geometry_msgs.msg import Twist as TwistMessage
import numpy as np
from std_msgs.msg import Bool

from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import range_of, Settings
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.evaluation.faults.fault import (
    always,
    at_first,
    BASE,
    EVERYWHERE,
    Fault,
    Faults,
    Prepare,
    SERVO,
    Strike,
    striking,
    StruckRun,
    world_change,
)
from visual_servo_epipolar.evaluation.faults.sensing import DESIRED, drop_some, late, lost, restamp
from visual_servo_epipolar.evaluation.live.world import (
    BreakableUnicycleNode,
    Envelope,
    HOP_NS,
    NODES,
    WorldSettings,
)
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.messages.route_folder import write_route
from visual_servo_epipolar.nodes.route_node import RouteNode
from visual_servo_epipolar.simulation.mounts.pan_tilt import PanTiltSettings
from visual_servo_epipolar.simulation.routes import rounded, route_scenario, Taught, teach
from visual_servo_epipolar.simulation.scenario import Scenario

COMMANDS = '/cmd_vel'


@striking
def _wheels(scene: StruckRun, *grips: tuple[float, float]) -> None:
    base = scene.world.nodes[BASE]
    grip = grips[int(scene.rng.integers(len(grips)))]
    scene.notes.append(f'left {grip[0]:g}, right {grip[1]:g} of the motion')
    scene.witness.record.interventions.broken_s.append(scene.witness.now_s)
    if isinstance(base, BreakableUnicycleNode):
        base.break_wheels(*grip)


@striking
def _becomes(scene: StruckRun, /, node: str, **ranges: tuple[float, float]) -> None:
    """Draw values of parameters of the simulated robot that hold from now on."""
    values = {name: round(scene.draw(*bounds), 4) for name, bounds in ranges.items()}
    scene.notes.append(f'{values}{scene.world.set(node, values)}')


def command(scene: StruckRun, linear: float, angular: float) -> None:
    """Let somebody else send a command."""
    twist = TwistMessage()
    twist.linear.x, twist.angular.z = linear, angular
    scene.world.wire.send(Envelope(COMMANDS, twist, 0))


def _garbage(scene: StruckRun) -> None:
    """Let somebody send twists that are no numbers, at 20 Hz for 3 s."""
    twists = ((math.nan, 0.0), (math.inf, 0.0), (0.0, -math.inf), (math.nan, math.nan))
    for number in range(60):
        scene.later(number / 20, lambda: command(scene, *twists[int(scene.rng.integers(4))]))


def _joystick(scene: StruckRun) -> None:
    """Let somebody drive the robot beside the servo, at 20 Hz for 4 s."""
    linear, angular = scene.draw(-0.3, 0.3), scene.draw(0.2, 0.5) * scene.side()
    scene.notes.append(f'{linear:.2f} m/s, {angular:.2f} rad/s')
    for number in range(80):
        scene.later(number / 20, partial(command, scene, linear, angular))


WHEELS: Faults = {
    'wheel_stuck': Fault(
        'a wheel, or both, stand still', _wheels((0.0, 1.0), (1.0, 0.0), (0.0, 0.0))
    ),
    'wheel_slips': Fault('a wheel loses a third of its motion', _wheels((0.66, 1.0), (1.0, 0.66))),
    'command_delay': Fault(
        'commands take 0.3 s to the motors', _becomes(BASE, command_delay=(0.3, 0.3))
    ),
    'dead_band_grows': Fault(
        'motors stand below 0.01 to 0.05 m/s and 0.02 to 0.08 rad/s',
        _becomes(BASE, dead_zone_linear=(0.01, 0.05), dead_zone_angular=(0.02, 0.08)),
    ),
    'base_nods': Fault(
        'the body nods by 0.5 to 2 deg',
        _becomes(BASE, nod=(0.009, 0.035), acceleration=(0.5, 1.0)),
    ),
    'shutter_rolls': Fault(
        'rows are read out within 10 to 33 ms', _becomes('camera_node', readout=(0.01, 0.033))
    ),
    'commands_dropped': Fault(
        'up to half of the commands lost', drop_some(COMMANDS), base_alone=True
    ),
    'base_deaf': always('commands do not arrive', lost(COMMANDS, 3.0, 10.0), base_alone=True),
    'joystick': Fault('a joystick at 20 Hz on cmd_vel for 4 s', _joystick),
    'commands_garbage': always('nan and inf on cmd_vel by somebody else', _garbage),
    'two_servos': always(
        'two servos on one cmd_vel',
        lambda scene: scene.world.start('servo_node', alias='servo_two'),
    ),
}


@striking
def _hung(scene: StruckRun, name: str) -> None:
    seconds = scene.spell(0.3, 8.0)
    scene.world.hang(name)
    if seconds < math.inf:
        scene.later(seconds, lambda: scene.world.resume(name))


@striking
def _restart(scene: StruckRun, name: str) -> None:
    """Let a node be gone for a while; the base begins at the start again."""
    seconds = scene.draw(0.05, 4.0)
    scene.notes.append(f'after {seconds:.1f} s')
    scene.world.kill(name)

    def again() -> None:
        if name == BASE:
            scene.witness.record.interventions.moved_s.append(scene.witness.now_s)
        scene.world.restart(name)

    scene.later(seconds, again)


@striking
def _transitions(scene: StruckRun, name: str) -> None:
    def turn(label: str) -> None:
        scene.notes.append(f'{label}: {scene.world.change_state(name, label)}')

    labels = ('configure', 'activate', 'deactivate', 'cleanup', 'shutdown')
    for _ in range(12):
        label = labels[int(scene.rng.integers(len(labels)))]
        scene.later(scene.draw(0.0, 5.0), partial(turn, label))


KINDS: Mapping[str, tuple[str, Callable[[str], Strike]]] = {
    'killed': ('is gone without a word', lambda name: lambda scene: scene.world.kill(name)),
    'ended': ('ends as by SIGINT', lambda name: lambda scene: scene.world.end(name)),
    'hung': ('does nothing, for a while or for good', _hung),
    'restarted': ('is gone, and comes back', _restart),
}
NODE_ENDS: Faults = {
    f'{name.removesuffix("_node")}_{kind}': always(
        f'{name} {words}', strike(name), base_alone=name == SERVO and kind != 'ended'
    )
    for name in NODES
    for kind, (words, strike) in KINDS.items()
} | {
    f'{name.removesuffix("_node")}_transitions': always(
        f'{name} is taken through its states', _transitions(name)
    )
    for name, kind in NODES.items()
    if hasattr(kind, 'trigger_deactivate')  # managed
}

ODOMETRY = '/odom'
ANGLES, COMMAND = '/joint_states', '/head/command'
RIG = 'pan_tilt'


def _heard(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    return replace(settings, servo=replace(settings.servo, odometry=True))


@striking
def _told(scene: StruckRun, change: Callable[[Any, list[Any]], object]) -> None:
    """Change each pose from now on; ``change`` gets it, and the first one that was changed."""
    first: list[Any] = []

    def alter(message: Any) -> None:
        pose = message.pose.pose
        if not first:
            place, turn = pose.position, pose.orientation
            first.extend((place.x, place.y, turn.z, turn.w))
        change(pose, first)

    scene.alter(ODOMETRY, alter)


def _frozen(pose: Any, first: list[Any]) -> None:
    pose.position.x, pose.position.y, pose.orientation.z, pose.orientation.w = first


def _mirror(pose: Any, first: list[Any]) -> None:
    pose.position.y, pose.orientation.z = -pose.position.y, -pose.orientation.z


def _begun_anew(pose: Any, first: list[Any]) -> None:
    pose.position.x, pose.position.y = pose.position.x - first[0], pose.position.y - first[1]


def on_a_head(
    settings: WorldSettings,
    rng: np.random.Generator,
    *,
    names: Mapping[str, str] | None = None,
    limits: tuple[float, float] | None = None,
) -> WorldSettings:
    """Return a world whose camera is on a head: of other ``names``, or pan ``limits`` drawn."""
    camera = PanTiltSettings(**asdict(settings.camera))
    if limits is not None:
        camera = replace(camera, head_pan_limit=float(rng.uniform(*limits)))
    return replace(
        settings,
        camera=camera,
        servo=replace(settings.servo, rig=RIG, law='smooth'),
        more={**settings.more, 'camera_node': {'rig': RIG, **(names or {})}},
    )


def _apart(scene: StruckRun) -> None:
    seconds = scene.draw(0.2, 3.0) * scene.side()
    scene.notes.append(f'by {seconds:+.2f} s')
    away_ns = round(seconds * NANOSECONDS)
    scene.alter(ANGLES, lambda angles: restamp(angles, lambda it: max(it + away_ns, 0)))


def _one_by_one(scene: StruckRun) -> None:
    """Let one joint be missing in the angles, later the other one, for good or not."""

    def leave_out(number: int, seconds: float) -> None:
        scene.alter(ANGLES, lambda it: (it.name.pop(number), it.position.pop(number)), seconds)

    first = int(scene.rng.integers(2))
    scene.notes.append(f'{("pan", "tilt")[first]} first')
    seconds = scene.draw(0.3, 3.0)
    leave_out(first, seconds)
    last = scene.spell(0.3, 3.0)
    scene.later(seconds + scene.draw(0.0, 3.0), lambda: leave_out(1 - first, last))


@striking
def _turned(scene: StruckRun, low: float, high: float) -> None:
    """Let the encoder of the pan joint be off by an angle from now on."""
    angle = scene.draw(low, high) * scene.side()
    scene.notes.append(f'by {angle:+.2f} rad')

    def change(message: Any) -> None:
        message.position[0] += angle

    scene.alter(ANGLES, change)


OTHER = {'pan_joint': 'head_pan_joint', 'tilt_joint': 'head_tilt_joint'}
WORDS = 'odometry, which is heard,'
ENCODERS: Faults = {
    'odometry_frozen': Fault(f'{WORDS} says the same pose for ever', _told(_frozen), _heard),
    'odometry_mirrored': Fault(f'{WORDS} has left for right', _told(_mirror), _heard),
    'odometry_reset': Fault(f'{WORDS} begins anew', _told(_begun_anew), _heard),
    'head_none': Fault('nothing is wrong with a head', prepare=on_a_head),
    'head_silent': always(
        'no angles of the head, a while or for good', lost(ANGLES, 0.3, 8.0), on_a_head
    ),
    'head_one_by_one': always('joints stay away one by one', _one_by_one, on_a_head),
    'head_names': at_first('joints have other names', prepare=partial(on_a_head, names=OTHER)),
    'head_stamps': always('angles and images 0.2 to 3 s apart', _apart, on_a_head),
    'head_dropped': Fault('up to half of the angles are lost', drop_some(ANGLES), on_a_head),
    'head_late': Fault('angles 0.1 to 1 s late', late(ANGLES, 0.1, 1.0), on_a_head),
    'head_stuck': Fault('the head does not hear its command', lost(COMMAND, 0.3, 8.0), on_a_head),
    'head_limit': at_first(
        'the head turns 3 to 17 deg to either side',
        prepare=partial(on_a_head, limits=(0.05, 0.3)),
    ),
    'head_leaps': Fault('the encoder leaps by 0.3 to 1 rad', _turned(0.3, 1.0), on_a_head),
    'head_slips': Fault('the encoder slips by 0.07 to 0.3 rad', _turned(0.07, 0.3), on_a_head),
}


CLOCK = '/clock'


@striking
def _clock_leaps(scene: StruckRun, low: float, high: float) -> None:
    """Set the wall clock, as NTP does."""
    seconds = scene.draw(low, high)
    scene.notes.append(f'by {seconds:+.1f} s')
    scene.world.wire.offset_ns += round(seconds * NANOSECONDS)


def _tick(scene: StruckRun, goes_on: Callable[[], bool] = lambda: True) -> None:
    """Publish /clock, of the wall clock, now and as long as it ``goes_on``."""
    wire = scene.world.wire
    wire.post(Envelope(CLOCK, write.clock(wire.wall_ns), 0))
    if goes_on():
        wire.at(wire.now_ns + NANOSECONDS // 50, lambda: _tick(scene, goes_on))


def _restart_clock(scene: StruckRun) -> None:
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
    'clock_forward': always('the wall clock leaps 1 to 300 s ahead', _clock_leaps(1.0, 300.0)),
    'clock_back': always('the wall clock leaps 0.1 to 900 s back', _clock_leaps(-900.0, -0.1)),
    'clock_stops': always('/clock stands still', lost(CLOCK, 0.5, 10.0), SIMULATED),
    'clock_freezes': at_first(
        'the /clock of the servo stands still, and images go on',
        _freeze,
        world_change(more={'servo_node': {'use_sim_time': True}}),
    ),
    'clock_restarts': always('/clock begins anew', _restart_clock, SIMULATED),
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
BUTTON = '/stop_button'
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
    for number in range(30):
        service = SERVICES[int(scene.rng.integers(len(SERVICES)))]
        scene.later(0.1 * number, partial(call, scene, service))
    scene.later(3.0, lambda: call(scene, '/servo_node/stop'))


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
    for number in range(16):
        scene.later(0.5 * number, partial(press, Bool(data=True)))
        scene.later(0.5 * number + 0.1, partial(other, Bool(data=False)))
    scene.later(scene.draw(1.0, 8.0), partial(_unheard_start, scene))


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
    scene.lose(DESIRED, LATER_S)
    for name in ('camera_node', 'tracker_node'):
        scene.world.kill(name)
    wire.forget(DESIRED)
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


def _lower_limits(scene: StruckRun) -> None:
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
    'limits_lowered': Fault('max_linear, max_angular lowered', _lower_limits),
    'parameters_servo': Fault(
        'parameters of the servo', _parameters('servo_node', ServoSettings())
    ),
    'parameters_tracker': Fault(
        'parameters of the tracker', _parameters('tracker_node', TrackerSettings())
    ),
}


SCENARIO = route_scenario(Scenario(), 1)
START = 3.0, -3.9, 0.0  # x, y [m], heading error [deg]
WAY = rounded((START[:2], (3.0, -1.2), (4.4, -1.2)))
ROUTE_NODES = {name: kind for name, kind in NODES.items() if name != 'tracker_node'}


@cache
def taught() -> tuple[Taught, TemporaryDirectory[str]]:
    """Return the route that was taught along WAY, and its folder."""
    folder, route = TemporaryDirectory(), teach(SCENARIO, WAY)
    write_route(route.route, Path(folder.name))
    return route, folder


def on_a_route(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    """Return a world in which the robot repeats a route."""
    return replace(
        settings,
        start=START,
        camera=replace(SCENARIO.camera, seed=settings.seed),
        servo=replace(settings.servo, law='smooth', max_linear=0.5, max_angular=1.0),
        kinds={**ROUTE_NODES, SERVO: RouteNode},
        more={**settings.more, SERVO: {'route': taught()[1].name}},
    )


def _lower_route_limits(scene: StruckRun) -> None:
    """Lower a limit of speed and one of turns, by either of their two names."""
    goals, route = scene.witness.record.interventions.goals, taught()[0]
    goals[:] = [route.stations[len(route.route.views) - 1]]
    names = (('max_speed', 'max_linear'), ('max_turn_rate', 'max_angular'))
    values = {pair[int(scene.rng.integers(2))]: scene.draw(0.05, 0.2) for pair in names}
    scene.notes.append(str(values) + scene.world.set(SERVO, values))


@cache
def new_folders() -> TemporaryDirectory[str]:
    """Return the folder of routes that are yet to be taught."""
    return TemporaryDirectory()


def by_hand(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    """Return a world in which a route is taught."""
    return replace(
        settings,
        servo=replace(settings.servo, autostart=False),
        kinds={**ROUTE_NODES, SERVO: RouteNode},
        more={**settings.more, SERVO: {'route': f'{new_folders().name}/{settings.seed}'}},
    )


def _leaps(scene: StruckRun) -> None:
    """Drive ahead by hand while a route is taught; odometry leaps on the way."""
    leap, world = scene.draw(0.3, 1.0) * scene.side(), scene.world
    scene.notes.append(f'by {leap:+.2f} m')

    def move(message: Any) -> None:
        message.pose.pose.position.x += leap

    def finish() -> None:
        answer = world.call(f'/{SERVO}/stop_recording')
        if Path(world.settings.more[SERVO]['route']).exists():
            scene.witness.record.wrong_route = answer

    scene.later(1.0, lambda: world.call(f'/{SERVO}/start_recording'))
    for number in range(80):
        scene.later(1.0 + 0.05 * number, lambda: command(scene, 0.3, 0.0))
    scene.later(5.0, lambda: command(scene, 0.0, 0.0))
    scene.later(scene.draw(2.0, 4.0), lambda: scene.alter(ODOMETRY, move))
    scene.later(6.0, finish)


ROUTES: Faults = {
    'teaching_odometry': at_first('odometry leaps while a route is taught', _leaps, by_hand),
    'route_limits_lowered': Fault(
        'limits of speed lowered in mid-route',
        _lower_route_limits,
        on_a_route,
        phases=EVERYWHERE[:1],
    ),
}
