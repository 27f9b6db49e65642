"""Joints in messages: what goes out comes back, what cannot be used is refused."""

import math
import sys
from types import ModuleType, SimpleNamespace

from hypothesis import example, given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.rigs.rig import HeadCommand, Joints
from visual_servo_epipolar.messages import read, transforms
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
    one = JointState(name=['tilt_joint'], position=[0.4])
    assert read_joints(one, NAMES) == {'tilt_joint': 0.4}


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


angles = st.floats(-math.pi, math.pi)


def rotation(message) -> Rotation:
    turn = message.transform.rotation
    return Rotation.from_quat([turn.x, turn.y, turn.z, turn.w])


def origin(message) -> list[float]:
    place = message.transform.translation
    return [place.x, place.y, place.z]


@given(axis=st.tuples(*[st.floats(-1.0, 1.0)] * 3), angle=angles)
@example((1.0, 0.0, 0.0), math.pi)  # a half turn is no special case
@example((0.0, 1.0, 0.0), math.pi)
@example((0.0, 0.0, 1.0), math.pi)
def test_the_quaternion_is_that_of_the_rotation(axis, angle) -> None:
    turn = Rotation.from_rotvec(np.array(axis) * angle)
    message = transforms.mount_transform('a', 'b', turn.as_matrix(), np.zeros(3))
    np.testing.assert_allclose(rotation(message).as_matrix(), turn.as_matrix(), atol=1e-12)
    numbers = message.transform.rotation
    assert math.hypot(numbers.x, numbers.y, numbers.z, numbers.w) == pytest.approx(1.0)
    assert numbers.w >= 0.0


def test_what_stands_on_the_floor_has_its_stamp_and_its_yaw() -> None:
    message = transforms.on_the_floor('odom', 'base_link', Pose(1.0, -2.0, 0.5), 1_500_000_000)
    assert (message.header.frame_id, message.child_frame_id) == ('odom', 'base_link')
    assert read.stamp_ns(message.header) == 1_500_000_000
    np.testing.assert_allclose(origin(message), [1.0, -2.0, 0.0])
    np.testing.assert_allclose(rotation(message).as_rotvec(), [0.0, 0.0, 0.5])


def test_without_tf2_msgs_there_is_no_message(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, 'tf2_msgs', None)
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', None)
    assert transforms.tf_message_class() is None


def test_with_tf2_msgs_there_is_its_message(monkeypatch) -> None:
    package, module = ModuleType('tf2_msgs'), ModuleType('tf2_msgs.msg')
    module.TFMessage = SimpleNamespace
    monkeypatch.setitem(sys.modules, 'tf2_msgs', package)
    monkeypatch.setitem(sys.modules, 'tf2_msgs.msg', module)
    assert transforms.tf_message_class() is SimpleNamespace
