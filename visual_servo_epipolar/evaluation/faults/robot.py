"""
The table of faults: one row each, under the invariant that it tries most.

The judge tries every run by every invariant. The route node is in the place of the servo, under
its name.
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
    driving,
    EVERYWHERE,
    Fault,
    Faults,
    SERVO,
    Strike,
    striking,
    StruckRun,
    Table,
    world_change,
)
from visual_servo_epipolar.evaluation.faults.judge import RunVerdict
from visual_servo_epipolar.evaluation.faults.sensing import (
    CAMERA,
    dropped,
    late,
    lost,
    restamped,
    TRACKER,
)
from visual_servo_epipolar.evaluation.faults.world import (
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

RIG = 'pan_tilt'
COMMANDS, CLOCK, BUTTON, ODOMETRY = '/cmd_vel', '/clock', '/stop_button', '/odom'
ANGLES, HEAD = '/joint_states', '/head/command'
SERVICES: Mapping[str, str] = {
    'start': '/servo_node/start',
    'stop': '/servo_node/stop',
    'reset': '/servo_node/reset',
    'capture': '/tracker_node/capture_desired',
    'redetect': '/tracker_node/redetect',
}
# Whoever changes these decides what counts as arrived, or as seen.
MEANT = ('arrival_', 'near_parallax', 'max_attempts', 'stale_timeout', 'law', 'final_turn')
LATER_S = 60.0  # when what was missing comes


@striking
def wheels(scene: StruckRun, *grips: tuple[float, float]) -> None:
    """Leave of the motion of each wheel, left and right, what one of ``grips`` has."""
    base = scene.world.nodes[BASE]
    grip = grips[int(scene.rng.integers(len(grips)))]
    scene.notes.append(f'left {grip[0]:g}, right {grip[1]:g} of the motion')
    scene.witness.record.interventions.broken_s.append(scene.witness.now_s)
    if isinstance(base, BreakableUnicycleNode):
        base.break_wheels(*grip)


@striking
def becomes(scene: StruckRun, /, node: str, **ranges: tuple[float, float]) -> None:
    """Draw values of parameters of a node that hold from now on."""
    values = {name: round(scene.draw(*bounds), 4) for name, bounds in ranges.items()}
    scene.notes.append(f'{values}{scene.world.set(node, values)}')


def command(scene: StruckRun, linear: float, angular: float) -> None:
    """Let another publisher send a command."""
    twist = TwistMessage()
    twist.linear.x, twist.angular.z = linear, angular
    scene.world.wire.send(Envelope(COMMANDS, twist, 0))


def _garbage(scene: StruckRun) -> None:
    """Send twists that are no numbers, at 20 Hz for 3 s."""
    twists = ((math.nan, 0.0), (math.inf, 0.0), (0.0, -math.inf), (math.nan, math.nan))
    for number in range(60):
        scene.later(number / 20, lambda: command(scene, *twists[int(scene.rng.integers(4))]))


def _joystick(scene: StruckRun) -> None:
    """Drive the robot beside the servo, at 20 Hz for 4 s."""
    linear, angular = scene.draw(-0.3, 0.3), scene.draw(0.2, 0.5) * scene.side()
    scene.notes.append(f'{linear:.2f} m/s, {angular:.2f} rad/s')

    def drive() -> None:
        scene.witness.record.interventions.driven_s.append(scene.witness.now_s)
        command(scene, linear, angular)

    for number in range(80):
        scene.later(number / 20, drive)


@striking
def hung(scene: StruckRun, name: str) -> None:
    """Let a node do nothing."""
    seconds = scene.spell(0.3, 8.0)
    scene.world.hang(name)
    if seconds < math.inf:
        scene.later(seconds, lambda: scene.world.resume(name))


@striking
def restarted(scene: StruckRun, name: str) -> None:
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
def transitions(scene: StruckRun, name: str) -> None:
    """Ask a managed node for twelve transitions."""

    def turn(label: str) -> None:
        scene.notes.append(f'{label}: {scene.world.change_state(name, label)}')

    labels = ('configure', 'activate', 'deactivate', 'cleanup', 'shutdown')
    for _ in range(12):
        label = labels[int(scene.rng.integers(len(labels)))]
        scene.later(scene.draw(0.0, 5.0), partial(turn, label))


NODE_KINDS: Mapping[str, tuple[str, Callable[[str], Strike]]] = {
    'killed': ('is gone without a word', lambda name: lambda scene: scene.world.kill(name)),
    'ended': ('ends as by SIGINT', lambda name: lambda scene: scene.world.end(name)),
    'hung': ('does nothing, for a while or for good', hung),
    'restarted': ('is gone, and comes back', restarted),
    'transitions': ('is taken through its states', transitions),
}


def node_faults() -> Faults:
    """Return what may happen to each node; transitions to managed ones alone."""
    return {
        f'{name.removesuffix("_node")}_{kind}': always(
            f'{name} {words}',
            strike(name),
            base_alone=name == SERVO and kind in ('killed', 'hung', 'restarted'),
        )
        for name, node in NODES.items()
        for kind, (words, strike) in NODE_KINDS.items()
        if kind != 'transitions' or hasattr(node, 'trigger_deactivate')
    }


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
        more={**settings.more, CAMERA: {'rig': RIG, **(names or {})}},
    )


def _joint_by_joint(scene: StruckRun) -> None:
    """Let one joint be missing in the angles, later the other one, for good or not."""

    def leave_out(number: int, seconds: float) -> None:
        scene.alter(ANGLES, lambda it: (it.name.pop(number), it.position.pop(number)), seconds)

    first, seconds = int(scene.rng.integers(2)), scene.draw(0.3, 3.0)
    scene.notes.append(f'{("pan", "tilt")[first]} first')
    leave_out(first, seconds)
    last = scene.spell(0.3, 3.0)
    scene.later(seconds + scene.draw(0.0, 3.0), lambda: leave_out(1 - first, last))


def _apart(scene: StruckRun) -> None:
    """Let the clock of the angles be another one than that of the images."""
    away_ns = round(scene.draw(0.2, 3.0) * scene.side() * NANOSECONDS)
    scene.notes.append(f'by {away_ns / NANOSECONDS:+.2f} s')
    restamped(ANGLES, lambda stamp_ns, _: max(stamp_ns + away_ns, 0))(scene)


def _slips(scene: StruckRun) -> None:
    """Let the encoder of the pan joint be off by an angle from now on."""
    angle = math.exp(scene.draw(math.log(0.07), 0.0)) * scene.side()
    scene.notes.append(f'by {angle:+.2f} rad')

    def change(message: Any) -> None:
        message.position[0] += angle

    scene.alter(ANGLES, change)


def _clock_leaps(scene: StruckRun) -> None:
    """Set the wall clock, as NTP does."""
    seconds = scene.draw(1.0, 300.0) if scene.hits(0.5) else scene.draw(-900.0, -0.1)
    scene.notes.append(f'by {seconds:+.1f} s')
    scene.world.wire.offset_ns += round(seconds * NANOSECONDS)


def _tick(scene: StruckRun, goes_on: Callable[[], bool] = lambda: True) -> None:
    """Publish /clock, of the wall clock, now and as long as it ``goes_on``."""
    wire = scene.world.wire
    wire.post(Envelope(CLOCK, write.clock(wire.wall_ns), 0))
    if goes_on():
        wire.at(wire.now_ns + NANOSECONDS // 50, lambda: _tick(scene, goes_on))


def _clock_restarts(scene: StruckRun) -> None:
    """Let the simulation begin at 0 again."""
    begin: list[int] = []

    def again(message: Any) -> None:
        now_ns = int(message.clock.sec) * NANOSECONDS + int(message.clock.nanosec)
        begin.append(now_ns)
        since_ns = now_ns - begin[0] + NANOSECONDS
        message.clock.sec, message.clock.nanosec = divmod(since_ns, NANOSECONDS)

    scene.alter(CLOCK, again)


def _clock_freezes(scene: StruckRun) -> None:
    """Let the /clock of the servo alone go for a while and then stand still; images go on."""
    wire, seconds = scene.world.wire, scene.draw(1.0, 7.0)
    scene.notes.append(f'after {seconds:.1f} s')
    end_ns = wire.now_ns + round(seconds * NANOSECONDS)
    _tick(scene, lambda: wire.now_ns < end_ns)
    scene.later(seconds, lambda: None)


def call(scene: StruckRun, service: str) -> None:
    """Call one of SERVICES, and note what that means for the goal, or for a robot that moves."""
    record, witness = scene.witness.record, scene.witness
    if service == 'capture':
        record.interventions.goals.append(witness.seen_pose)
    if service == 'stop':
        scene.note_stop()
    answer = scene.world.call(SERVICES[service])
    if service == 'start' and answer.startswith(('started', 'armed')):
        record.interventions.stopped_s = math.inf
    scene.notes.append(f'{service}: {answer}')


def _storm(scene: StruckRun) -> None:
    """Call services at random, ending with a stop: nothing but the stop counts then."""
    for number in range(30):
        service = [*SERVICES][int(scene.rng.integers(len(SERVICES)))]
        scene.later(0.1 * number, partial(call, scene, service))
    scene.later(3.0, lambda: call(scene, 'stop'))


def _press(scene: StruckRun) -> None:
    """Press the stop button for a while; released, it leaves the robot standing."""
    wire, hop = scene.world.wire, HOP_NS
    wire.post(Envelope(BUTTON, Bool(data=True), hop))
    scene.note_stop()
    release = Envelope(BUTTON, Bool(data=False), hop)
    scene.later(scene.draw(0.05, 5.0), lambda: wire.post(release))


def _two_buttons(scene: StruckRun) -> None:
    """Press one stop button while a second one reports all the time that it is not pressed."""
    press, other = (scene.world.talker(name, Bool, BUTTON) for name in ('button', 'second_button'))
    scene.note_stop()
    for number in range(16):
        scene.later(0.5 * number, partial(press, Bool(data=True)))
        scene.later(0.5 * number + 0.1, partial(other, Bool(data=False)))
    scene.later(scene.draw(1.0, 8.0), partial(_vain_start, scene))


def _vain_start(scene: StruckRun) -> None:
    """Call ``~/start`` where nothing may follow from it."""
    scene.notes.append(f'start: {scene.world.call(SERVICES["start"])}')


@striking
def too_early(scene: StruckRun, missing: str) -> None:
    """Order to start while something is ``missing`` that comes a minute later: a node of ours."""
    scene.world.kill(missing)
    scene.later(1.0, partial(_vain_start, scene))
    scene.note_stop()
    scene.later(LATER_S, partial(scene.world.restart, missing))


def _before_the_clock(scene: StruckRun) -> None:
    """Order to start a servo of simulated time, of which /clock comes a minute later."""
    scene.later(2.0, partial(_vain_start, scene))
    scene.note_stop()
    scene.later(LATER_S, partial(_tick, scene))


def _servo(settings: WorldSettings, rng: np.random.Generator, **changes: Any) -> WorldSettings:
    return replace(settings, servo=replace(settings.servo, **changes))


def _without_clock(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    return replace(_servo(settings, rng, autostart=False), more={SERVO: {'use_sim_time': True}})


def _carry(scene: StruckRun) -> None:
    """Carry the robot back to the start, as ``~/reset`` of the base does."""
    scene.witness.record.interventions.moved_s.append(scene.witness.now_s)
    scene.notes.append(scene.world.call('/unicycle_node/reset'))


@striking
def parameters(scene: StruckRun, node: str, settings: Settings) -> None:
    """Set some parameters of ``node`` to anything that they may be, one by one."""
    items = [
        item
        for item in fields(settings)
        if not range_of(item).read_only and not item.name.startswith(MEANT)
    ]

    def set_now(values: Mapping[str, Any]) -> None:
        refusal = scene.world.set(node, values)
        scene.notes.append(f'{values}{": " if refusal else ""}{refusal}')

    for number in range(int(scene.rng.integers(1, 4))):
        item = items[int(scene.rng.integers(len(items)))]
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
    low = -math.inf if allowed.low is None else allowed.low
    high = math.inf if allowed.high is None else allowed.high
    value = min(max(now * math.exp(scene.draw(-2.0, 2.0)), low), high)
    return round(value) if isinstance(now, int) else float(value)


SCENARIO = route_scenario(Scenario(), 1)
START = 3.0, -3.9, 0.0  # x, y [m], heading error [deg]
WAY = rounded((START[:2], (3.0, -1.2), (4.4, -1.2)))
ROUTE_NODES = {name: kind for name, kind in NODES.items() if name != TRACKER}


@cache
def taught() -> tuple[Taught, TemporaryDirectory[str]]:
    """Return the route that was taught along WAY, and its folder."""
    folder, route = TemporaryDirectory(), teach(SCENARIO, WAY)
    write_route(route.route, Path(folder.name))
    return route, folder


@cache
def new_folders() -> TemporaryDirectory[str]:
    """Return the folder of routes that are yet to be taught."""
    return TemporaryDirectory()


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


def by_hand(settings: WorldSettings, rng: np.random.Generator) -> WorldSettings:
    """Return a world in which a route is taught."""
    return replace(
        settings,
        servo=replace(settings.servo, autostart=False),
        kinds={**ROUTE_NODES, SERVO: RouteNode},
        more={**settings.more, SERVO: {'route': f'{new_folders().name}/{settings.seed}'}},
    )


@striking
def lowered(scene: StruckRun, low: float, high: float, *pairs: tuple[str, ...]) -> None:
    """Lower a limit of speed and one of turns, each by one of its names."""
    values = {pair[int(scene.rng.integers(len(pair)))]: scene.draw(low, high) for pair in pairs}
    scene.notes.append(str(values) + scene.world.set(SERVO, values))


def _lower_on_a_route(scene: StruckRun) -> None:
    goals, route = scene.witness.record.interventions.goals, taught()[0]
    goals[:] = [route.stations[len(route.route.views) - 1]]
    lowered(0.05, 0.2, *LIMITS_OF_ROUTE)(scene)


def _taught_by_leaps(scene: StruckRun) -> None:
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


POSES: Mapping[str, Callable[[Any, list[float]], tuple[float, ...]]] = {
    'frozen': lambda pose, first: tuple(first),
    'mirrored': lambda pose, first: (pose[0], -pose[1], -pose[2], pose[3]),
    'begun anew': lambda pose, first: (pose[0] - first[0], pose[1] - first[1], *pose[2:]),
}


@striking
def posed(scene: StruckRun, topic: str, change: str) -> None:
    """Let each pose of ``topic`` (x, y, z, w) be what one of POSES makes of it and the first."""
    first: list[float] = []
    scene.notes.append(change)

    def alter(message: Any) -> None:
        place, turn = message.pose.pose.position, message.pose.pose.orientation
        pose = place.x, place.y, turn.z, turn.w
        first.extend(pose if not first else ())
        place.x, place.y, turn.z, turn.w = POSES[change](pose, first)

    scene.alter(topic, alter)


SIMULATED = world_change(simulated_time=True)
ON_CLOCK = world_change(more={SERVO: {'use_sim_time': True}})
WAITS = partial(_servo, autostart=False)
JOINTS = {'pan_joint': 'head_pan_joint', 'tilt_joint': 'head_tilt_joint'}
LIMITS_OF_SERVO = ('max_linear',), ('max_angular',)
LIMITS_OF_ROUTE = ('max_speed', 'max_linear'), ('max_turn_rate', 'max_angular')
ROBOT: Table = {
    RunVerdict.BLIND: {
        'clock_leaps': always('the wall clock leaps, ahead or back', _clock_leaps),
        'clock_stops': always('/clock stands still', lost(CLOCK, 0.5, 10.0), prepare=SIMULATED),
        'clock_restarts': always('/clock begins anew', _clock_restarts, prepare=SIMULATED),
        'clock_freezes': at_first('/clock of the servo stops', _clock_freezes, prepare=ON_CLOCK),
        'commands_dropped': driving('half of commands lost', dropped(COMMANDS), base_alone=True),
        'base_deaf': always('no commands arrive', lost(COMMANDS, 3.0, 10.0), base_alone=True),
        **node_faults(),
    },
    RunVerdict.WRONG_ARRIVAL: {
        'none': driving('nothing is wrong'),
        'shutter_rolls': driving(
            'rows are read out within 10 to 33 ms', becomes(CAMERA, readout=(0.01, 0.033))
        ),
        'base_nods': driving(
            'the body nods',
            becomes(BASE, nod=(0.009, 0.035), acceleration=(0.5, 1.0)),
        ),
        'dead_band_grows': driving(
            'motors stand below 0.01 to 0.05 m/s and 0.02 to 0.08 rad/s',
            becomes(BASE, dead_zone_linear=(0.01, 0.05), dead_zone_angular=(0.02, 0.08)),
        ),
        'command_delay': driving('commands take 0.3 s', becomes(BASE, command_delay=(0.3, 0.3))),
        'wheel_stuck': driving(
            'a wheel, or both, stand still', wheels((0.0, 1.0), (1.0, 0.0), (0.0, 0.0))
        ),
        'wheel_slips': driving('a wheel slips by a third', wheels((0.66, 1.0), (1.0, 0.66))),
        'carried': always('the robot is carried to the start', _carry),
        'odometry_wrong': driving(
            'odometry, which is heard, stands still, has left for right, or begins anew',
            *(posed(ODOMETRY, change) for change in POSES),
            prepare=partial(_servo, odometry=True),
        ),
        'head_none': driving('nothing is wrong with a head', prepare=on_a_head),
        'head_silent': always(
            'no angles of the head, or joints away one by one, or half of the angles lost',
            lost(ANGLES, 0.3, 8.0),
            _joint_by_joint,
            dropped(ANGLES),
            prepare=on_a_head,
        ),
        'head_names': at_first('joints of other names', prepare=partial(on_a_head, names=JOINTS)),
        'head_late': always(
            'angles late, or stamped by another clock',
            late(ANGLES, 0.1, 1.0),
            _apart,
            prepare=on_a_head,
        ),
        'head_stuck': driving('the head does not obey', lost(HEAD, 0.3, 8.0), prepare=on_a_head),
        'head_limit': at_first(
            'it turns by 3 to 17 deg', prepare=partial(on_a_head, limits=(0.05, 0.3))
        ),
        'head_slips': driving('the encoder slips by 0.07 to 1 rad', _slips, prepare=on_a_head),
    },
    RunVerdict.DISOBEYED: {
        **{f'order_{name}': always(f'~/{name}', partial(call, service=name)) for name in SERVICES},
        'order_storm': always('30 services in 3 s, then ~/stop', _storm),
        'order_button': always('the stop button is pressed, and released', _press),
        'order_two_buttons': always('one of two stop buttons is pressed', _two_buttons),
        'arming_camera': at_first('~/start, no camera', too_early(CAMERA), prepare=WAITS),
        'arming_tracker': at_first('~/start, no tracker', too_early(TRACKER), prepare=WAITS),
        'arming_clock': at_first('~/start, no /clock', _before_the_clock, prepare=_without_clock),
    },
    RunVerdict.LIMITS: {
        'joystick': driving('a joystick at 20 Hz on cmd_vel for 4 s', _joystick),
        'commands_garbage': always('nan and inf on cmd_vel from another publisher', _garbage),
        'two_servos': always(
            'two servos on one cmd_vel', lambda scene: scene.world.start(SERVO, alias='servo_two')
        ),
        'limits_lowered': driving('limits of speed lowered', lowered(0.02, 0.1, *LIMITS_OF_SERVO)),
        'route_limits_lowered': Fault(
            'limits of speed lowered in mid-route', _lower_on_a_route, on_a_route, EVERYWHERE[:1]
        ),
        'parameters_servo': driving('parameters of the servo', parameters(SERVO, ServoSettings())),
        'parameters_tracker': driving(
            'parameters of the tracker', parameters(TRACKER, TrackerSettings())
        ),
    },
    RunVerdict.WRONG_ROUTE: {
        'teaching_odometry': at_first(
            'odometry leaps in teaching', _taught_by_leaps, prepare=by_hand
        ),
    },
}
