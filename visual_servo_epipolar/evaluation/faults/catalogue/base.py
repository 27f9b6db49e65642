"""Faults between servo and wheels."""

from collections.abc import Callable, Mapping
import math
from types import MappingProxyType

from geometry_msgs.msg import Twist as TwistMessage

from visual_servo_epipolar.evaluation.faults.catalogue.fault import ALWAYS, Fault, Scene
from visual_servo_epipolar.evaluation.faults.catalogue.streams import dropped
from visual_servo_epipolar.evaluation.live.breakable_base import BreakableUnicycleNode
from visual_servo_epipolar.evaluation.live.wire import Envelope

COMMANDS = '/cmd_vel'
DELAY_S = 0.3
OTHERS = ((math.nan, 0.0), (math.inf, 0.0), (0.0, -math.inf), (math.nan, math.nan))
OTHERS_S = 3.0
JOYSTICK_RATE, JOYSTICK_S = 20, 4.0  # [Hz], [s]
JOYSTICK = (-0.3, 0.3), (0.2, 0.5)  # speeds that it asks for, ahead [m/s] and to a side [rad/s]


def _wheels(*grips: tuple[float, float]) -> Callable[[Scene], None]:
    def strike(scene: Scene) -> None:
        base = scene.world.nodes['unicycle_node']
        grip = grips[int(scene.rng.integers(len(grips)))]
        scene.notes.append(f'left {grip[0]:g}, right {grip[1]:g} of the motion')
        scene.witness.record.broken_s.append(scene.witness.now_s)
        if isinstance(base, BreakableUnicycleNode):
            base.break_wheels(*grip)

    return strike


def _delay(scene: Scene) -> None:
    scene.notes.append(scene.world.set('unicycle_node', {'command_delay': DELAY_S}))


def _garbage(scene: Scene) -> None:
    """Let somebody send twists that are no numbers."""

    def send() -> None:
        twist = TwistMessage()
        twist.linear.x, twist.angular.z = OTHERS[int(scene.rng.integers(len(OTHERS)))]
        scene.world.wire.send(Envelope(COMMANDS, twist, 0))

    for number in range(round(OTHERS_S * 20)):
        scene.later(number / 20, send)


def _disconnected(scene: Scene) -> None:
    """Let no command reach the base."""
    scene.filter(COMMANDS, lambda envelope: [], scene.spell(3.0, 10.0))


def _joystick(scene: Scene) -> None:
    """Let somebody drive the robot beside the servo."""
    twist = TwistMessage()
    twist.linear.x = scene.draw(*JOYSTICK[0])
    twist.angular.z = scene.draw(*JOYSTICK[1]) * (1.0 if scene.hits(0.5) else -1.0)
    scene.notes.append(f'{twist.linear.x:.2f} m/s, {twist.angular.z:.2f} rad/s')
    for number in range(round(JOYSTICK_S * JOYSTICK_RATE)):
        scene.later(
            number / JOYSTICK_RATE, lambda: scene.world.wire.send(Envelope(COMMANDS, twist, 0))
        )


def _second_servo(scene: Scene) -> None:
    """Start one more servo on the same tracks and the same cmd_vel."""
    scene.world.start('servo_node', alias='servo_two')


FAULTS: Mapping[str, Fault] = MappingProxyType(
    {
        'wheel_stuck': Fault(
            what='a wheel, or both, stand still',
            strike=_wheels((0.0, 1.0), (1.0, 0.0), (0.0, 0.0)),
        ),
        'wheel_slips': Fault(
            what='a wheel loses a third of its motion', strike=_wheels((0.66, 1.0), (1.0, 0.66))
        ),
        'command_delay': Fault(what='commands take 0.3 s to the motors', strike=_delay),
        'commands_dropped': Fault(
            what='up to half of the commands lost', strike=dropped(COMMANDS), base_alone=True
        ),
        'base_deaf': Fault(
            what='commands do not arrive', strike=_disconnected, phases=ALWAYS, base_alone=True
        ),
        'joystick': Fault(what='a joystick at 20 Hz on cmd_vel for 4 s', strike=_joystick),
        'commands_garbage': Fault(
            what='nan and inf on cmd_vel by somebody else', strike=_garbage, phases=ALWAYS
        ),
        'two_servos': Fault(what='two servos on one cmd_vel', strike=_second_servo, phases=ALWAYS),
    }
)
