"""Joints in messages: what goes out comes back, what cannot be used is refused."""

import math

import pytest
from sensor_msgs.msg import JointState

from visual_servo_epipolar.core.rigs.rig import HeadCommand, Joints
from visual_servo_epipolar.messages.joints import (
    COMMAND_TYPES,
    head_command,
    joint_states,
    read_head_command,
    read_joints,
)

NAMES = 'pan_joint', 'tilt_joint'
COMMAND = HeadCommand(0.3, -0.1, 0.5, 0.2)


def test_angles_come_back_from_among_others() -> None:
    message = joint_states(Joints(0.3, -0.2), NAMES, 7)
    message.name, message.position = ['wheel', *message.name], [9.0, *message.position]
    assert read_joints(message, NAMES) == {'pan_joint': 0.3, 'tilt_joint': -0.2}
    assert read_joints(message, ('other', 'another')) == {}
    assert read_joints(JointState(name=['tilt_joint'], position=[0.4]), NAMES) == {
        'tilt_joint': 0.4
    }


def test_a_head_without_tilt_has_no_angle_of_it() -> None:
    message = joint_states(Joints(0.4, 0.0), ('pan', ''), 7)
    assert list(message.name) == ['pan']
    assert read_joints(message, ('pan', '')) == {'pan': 0.4}


def test_positions_that_are_not_those_of_the_names_are_refused() -> None:
    with pytest.raises(ValueError, match='a position for each of its 2 joints, got 1'):
        read_joints(JointState(name=[*NAMES], position=[0.1]), NAMES)


@pytest.mark.parametrize('kind', COMMAND_TYPES)
def test_a_command_comes_back(kind: str) -> None:
    message = head_command(COMMAND, NAMES, 7, kind=kind)
    assert isinstance(message, COMMAND_TYPES[kind])
    found = read_head_command(message, NAMES)
    if kind == 'velocity':
        assert math.isnan(found.pan)
        assert (found.pan_rate, found.tilt_rate) == (0.5, 0.2)
    else:
        assert (found.pan, found.tilt) == (0.3, -0.1)


def test_a_command_to_others_is_refused() -> None:
    with pytest.raises(ValueError, match='head/command must have finite angles or rates of pan'):
        read_head_command(head_command(COMMAND, ('a', 'b'), 7, kind='position'), NAMES)
    with pytest.raises(ValueError, match='finite angles or rates of pan_joint, tilt_joint'):
        read_head_command(head_command(COMMAND, ('pan_joint', ''), 7, kind='position'), NAMES)
