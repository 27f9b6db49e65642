"""Faults between servo and wheels."""

import math

from geometry_msgs.msg import Twist as TwistMessage

from visual_servo_epipolar.evaluation.faults.catalogue.fault import (
    always,
    Fault,
    Faults,
    Strike,
    StruckRun,
)
from visual_servo_epipolar.evaluation.faults.catalogue.streams import drop_some
from visual_servo_epipolar.evaluation.live.breakable_base import BreakableUnicycleNode
from visual_servo_epipolar.evaluation.live.wire import Envelope

COMMANDS = '/cmd_vel'
DELAY_S = 0.3
OTHERS = ((math.nan, 0.0), (math.inf, 0.0), (0.0, -math.inf), (math.nan, math.nan))
RATE, GARBAGE_S, JOYSTICK_S = 20, 3.0, 4.0  # of others on cmd_vel [Hz], and for how long [s]
JOYSTICK = (-0.3, 0.3), (0.2, 0.5)  # speeds that it asks for, ahead [m/s] and to a side [rad/s]


def _wheels(*grips: tuple[float, float]) -> Strike:
    def strike(scene: StruckRun) -> None:
        base = scene.world.nodes['unicycle_node']
        grip = grips[int(scene.rng.integers(len(grips)))]
        scene.notes.append(f'left {grip[0]:g}, right {grip[1]:g} of the motion')
        scene.witness.record.interventions.broken_s.append(scene.witness.now_s)
        if isinstance(base, BreakableUnicycleNode):
            base.break_wheels(*grip)

    return strike


def _delay(scene: StruckRun) -> None:
    scene.notes.append(scene.world.set('unicycle_node', {'command_delay': DELAY_S}))


def _command(scene: StruckRun, linear: float, angular: float) -> None:
    twist = TwistMessage()
    twist.linear.x, twist.angular.z = linear, angular
    scene.world.wire.send(Envelope(COMMANDS, twist, 0))


def _garbage(scene: StruckRun) -> None:
    """Let somebody send twists that are no numbers."""
    for number in range(round(GARBAGE_S * RATE)):
        scene.later(
            number / RATE,
            lambda: _command(scene, *OTHERS[int(scene.rng.integers(len(OTHERS)))]),
        )


def _joystick(scene: StruckRun) -> None:
    """Let somebody drive the robot beside the servo."""
    linear = scene.draw(*JOYSTICK[0])
    angular = scene.draw(*JOYSTICK[1]) * (1.0 if scene.hits(0.5) else -1.0)
    scene.notes.append(f'{linear:.2f} m/s, {angular:.2f} rad/s')
    for number in range(round(JOYSTICK_S * RATE)):
        scene.later(number / RATE, lambda: _command(scene, linear, angular))


FAULTS: Faults = {
    'wheel_stuck': Fault(
        'a wheel, or both, stand still', _wheels((0.0, 1.0), (1.0, 0.0), (0.0, 0.0))
    ),
    'wheel_slips': Fault('a wheel loses a third of its motion', _wheels((0.66, 1.0), (1.0, 0.66))),
    'command_delay': Fault('commands take 0.3 s to the motors', _delay),
    'commands_dropped': Fault(
        'up to half of the commands lost', drop_some(COMMANDS), base_alone=True
    ),
    'base_deaf': always(
        'commands do not arrive',
        lambda scene: scene.lose(COMMANDS, scene.spell(3.0, 10.0)),
        base_alone=True,
    ),
    'joystick': Fault('a joystick at 20 Hz on cmd_vel for 4 s', _joystick),
    'commands_garbage': always('nan and inf on cmd_vel by somebody else', _garbage),
    'two_servos': always(
        'two servos on one cmd_vel',
        lambda scene: scene.world.start('servo_node', alias='servo_two'),
    ),
}
