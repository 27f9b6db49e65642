"""
Faults of the robot: of wheels and commands, of nodes that are gone or hang, of what encoders say.

Encoders of wheels, to a servo that hears odometry, and of a head: they lie, begin anew, or fall
silent; a head is misnamed, stuck, at its limit, apart in time.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from functools import partial
import math
from typing import Any

from geometry_msgs.msg import Twist as TwistMessage
import numpy as np

from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    always,
    at_first,
    Fault,
    Faults,
    Strike,
    striking,
    StruckRun,
)
from visual_servo_epipolar.evaluation.faults.catalogue.streams import (
    drop_some,
    late,
    lost,
    restamp,
)
from visual_servo_epipolar.evaluation.live.wire import Envelope
from visual_servo_epipolar.evaluation.live.world import BreakableUnicycleNode, NODES, WorldSettings
from visual_servo_epipolar.simulation.mounts.pan_tilt import PanTiltSettings

COMMANDS = '/cmd_vel'
OTHERS = ((math.nan, 0.0), (math.inf, 0.0), (0.0, -math.inf), (math.nan, math.nan))
RATE, GARBAGE_S, JOYSTICK_S = 20, 3.0, 4.0  # of others on cmd_vel [Hz], and for how long [s]
JOYSTICK = (-0.3, 0.3), (0.2, 0.5)  # speeds that it asks for, ahead [m/s] and to a side [rad/s]


@striking
def _wheels(scene: StruckRun, *grips: tuple[float, float]) -> None:
    base = scene.world.nodes['unicycle_node']
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
    """Let somebody send twists that are no numbers."""
    for number in range(round(GARBAGE_S * RATE)):
        scene.later(
            number / RATE,
            lambda: command(scene, *OTHERS[int(scene.rng.integers(len(OTHERS)))]),
        )


def _joystick(scene: StruckRun) -> None:
    """Let somebody drive the robot beside the servo."""
    linear = scene.draw(*JOYSTICK[0])
    angular = scene.draw(*JOYSTICK[1]) * scene.side()
    scene.notes.append(f'{linear:.2f} m/s, {angular:.2f} rad/s')
    for number in range(round(JOYSTICK_S * RATE)):
        scene.later(number / RATE, lambda: command(scene, linear, angular))


BASE: Faults = {
    'wheel_stuck': Fault(
        'a wheel, or both, stand still', _wheels((0.0, 1.0), (1.0, 0.0), (0.0, 0.0))
    ),
    'wheel_slips': Fault('a wheel loses a third of its motion', _wheels((0.66, 1.0), (1.0, 0.66))),
    'command_delay': Fault(
        'commands take 0.3 s to the motors', _becomes('unicycle_node', command_delay=(0.3, 0.3))
    ),
    'dead_band_grows': Fault(
        'motors stand below 0.01 to 0.05 m/s and 0.02 to 0.08 rad/s',
        _becomes('unicycle_node', dead_zone_linear=(0.01, 0.05), dead_zone_angular=(0.02, 0.08)),
    ),
    'base_nods': Fault(
        'the body nods by 0.5 to 2 deg',
        _becomes('unicycle_node', nod=(0.009, 0.035), acceleration=(0.5, 1.0)),
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

TRANSITIONS = ('configure', 'activate', 'deactivate', 'cleanup', 'shutdown')
TRANSITIONS_IN_A_RUN = 12


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
        if name == 'unicycle_node':
            scene.witness.record.interventions.moved_s.append(scene.witness.now_s)
        scene.world.restart(name)

    scene.later(seconds, again)


@striking
def _transitions(scene: StruckRun, name: str) -> None:
    def turn(label: str) -> None:
        scene.notes.append(f'{label}: {scene.world.change_state(name, label)}')

    for _ in range(TRANSITIONS_IN_A_RUN):
        label = TRANSITIONS[int(scene.rng.integers(len(TRANSITIONS)))]
        scene.later(scene.draw(0.0, 5.0), partial(turn, label))


KINDS: Mapping[str, tuple[str, Callable[[str], Strike]]] = {
    'killed': ('is gone without a word', lambda name: lambda scene: scene.world.kill(name)),
    'ended': ('ends as by SIGINT', lambda name: lambda scene: scene.world.end(name)),
    'hung': ('does nothing, for a while or for good', _hung),
    'restarted': ('is gone, and comes back', _restart),
}
NODE_ENDS: Faults = {
    f'{name.removesuffix("_node")}_{kind}': always(
        f'{name} {words}', strike(name), base_alone=name == 'servo_node' and kind != 'ended'
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
    scene.alter(
        ANGLES, lambda message: restamp(message, lambda stamp_ns: max(stamp_ns + away_ns, 0))
    )


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
        message.position = [message.position[0] + angle, *list(message.position)[1:]]

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
