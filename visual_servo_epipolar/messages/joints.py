"""Joints of a head in messages: angles as JointState, its command as JointState or trajectory."""

from collections.abc import Mapping, Sequence
import math
from typing import Any

from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from visual_servo_epipolar.core.errors import listed
from visual_servo_epipolar.core.rigs.rig import HeadCommand, Joints
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.messages.write import header

# What goes out on head/command, by what it tells.
COMMAND_TYPES: Mapping[str, type[Any]] = {
    'position': JointState,
    'velocity': JointState,
    'trajectory': JointTrajectory,
}
REACHED_S = 0.1  # from now, when a trajectory is to be there


def read_joints(message: Any, names: Sequence[str]) -> dict[str, float]:
    """
    Return the angles in a sensor_msgs/JointState of those of the joints ``names`` that it has.

    Many publish on one topic, each of them some joints. Raises ValueError for a message with one
    of these that cannot be used.
    """
    present = list(message.name)
    if not set(names) & set(present):
        return {}
    if len(message.position) != len(present):
        raise ValueError(
            f'joint_states must have a position for each of its {len(present)} joints, got '
            f'{len(message.position)}; check which node publishes them'
        )
    angles = dict(zip(present, map(float, message.position), strict=True))
    return {name: angles[name] for name in names if name in angles}


def joint_states(joints: Joints, names: tuple[str, str], stamp_ns: int) -> JointState:
    """Return angles as a sensor_msgs/JointState; an empty name has no joint."""
    rows = [(name, float(angle)) for name, angle in zip(names, joints, strict=True) if name]
    message = JointState(header=header(stamp_ns, ''))
    message.name, message.position = (list(column) for column in zip(*rows, strict=True))
    return message


def head_command(
    command: HeadCommand, names: tuple[str, str], stamp_ns: int, *, kind: str
) -> JointState | JointTrajectory:
    """Return a command to a head, of a ``kind`` of COMMAND_TYPES; an empty name has no joint."""
    columns = names, (command.pan, command.tilt), (command.pan_rate, command.tilt_rate)
    rows = [(row[0], *map(float, row[1:])) for row in zip(*columns, strict=True) if row[0]]
    present, angles, rates = (list(column) for column in zip(*rows, strict=True))
    if kind == 'trajectory':
        point = JointTrajectoryPoint(positions=angles)
        point.time_from_start.nanosec = round(REACHED_S * NANOSECONDS)
        # Stamped zero: to begin at once, whatever the clock of the controller says.
        return JointTrajectory(joint_names=present, points=[point])
    message = JointState(header=header(stamp_ns, ''), name=present)
    if kind == 'velocity':
        message.velocity = rates
    else:
        message.position = angles
    return message


def read_head_command(message: Any, names: tuple[str, str]) -> HeadCommand:
    """
    Return the command in a sensor_msgs/JointState or trajectory_msgs/JointTrajectory.

    One of rates alone has angles of nan. Raises ValueError for one that cannot be used.
    """
    if hasattr(message, 'points'):
        known, point = list(message.joint_names), message.points[-1] if message.points else None
        angles, rates = ([], []) if point is None else (list(point.positions), [])
    else:
        known, angles, rates = list(message.name), list(message.position), list(message.velocity)
    values = angles or rates
    lacks = not {name for name in names if name} <= set(known)
    if lacks or len(values) != len(known) or not all(map(math.isfinite, values)):
        raise ValueError(
            f'head/command must have finite angles or rates of {listed(names)}, got '
            f'{listed(known)} with {values}; set pan_joint and tilt_joint of servo and head alike'
        )
    given = dict(zip(known, map(float, values), strict=True))
    pan, tilt = given[names[0]], given.get(names[1], 0.0)
    if angles:
        return HeadCommand(pan, tilt)
    return HeadCommand(math.nan, math.nan, pan, tilt)
