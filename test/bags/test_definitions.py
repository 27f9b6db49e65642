"""Definitions of messages: of ROS itself, of workspaces that are sourced, and of nobody."""

from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader

from visual_servo_epipolar.bags.definitions import definition, hash_of
from visual_servo_epipolar.bags.metadata import Topic
from visual_servo_epipolar.bags.recording.recorder import Recorder
from visual_servo_epipolar.core.errors import InputError

OWN = 'own_msgs/msg/Own'


@pytest.fixture
def workspace(tmp_path, monkeypatch) -> Path:
    """Source a workspace with a message that is made of another and of a list of it."""
    folder = tmp_path / 'install/share/own_msgs/msg'
    folder.mkdir(parents=True)
    (folder / 'Own.msg').write_text('Bit first  # a comment\nBit[] rest\nfloat64[3] position\n')
    (folder / 'Bit.msg').write_text('int32 ONE=1\nint32 value\n')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path / 'install'))
    return folder


def test_a_type_of_a_sourced_workspace_is_defined_with_its_parts(workspace) -> None:
    text, digest = definition(OWN)
    assert 'MSG: own_msgs/Bit' in text and 'int32 ONE=1' in text
    assert digest.startswith('RIHS01_') and digest == hash_of(OWN, text)


def test_its_messages_can_be_read_where_nobody_knows_it(workspace, tmp_path, monkeypatch) -> None:
    recorder = Recorder(tmp_path / 'bag')
    topic = Topic('/own', OWN)
    recorder.add(topic)
    body = b'\x07\x00\x00\x00' + b'\x01\x00\x00\x00' + b'\x08\x00\x00\x00' + bytes(4) + bytes(24)
    recorder.put(topic, 1, b'\x00\x01\x00\x00' + body)
    recorder.close()
    monkeypatch.delenv('AMENT_PREFIX_PATH')
    with AnyReader([tmp_path / 'bag']) as reader:
        ((connection, _, data),) = reader.messages()
        message = reader.deserialize(data, connection.msgtype)
    assert (message.first.value, [item.value for item in message.rest]) == (7, [8])


def test_a_type_that_another_version_defines_otherwise_is_refused(workspace) -> None:
    with pytest.raises(InputError, match=f'no definition of {OWN} RIHS01_1 is known; source'):
        definition(OWN, 'RIHS01_1')


def test_a_part_that_is_missing_is_refused(workspace) -> None:
    (workspace / 'Bit.msg').unlink()
    with pytest.raises(InputError, match=f'no definition of {OWN}'):
        definition(OWN)
