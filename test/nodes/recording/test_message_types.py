"""Names of types come from the network: only those of messages are imported."""

import sys

import pytest
from std_msgs.msg import String

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.nodes.recording.raw_subscriptions import message_class


def test_a_message_is_found_by_its_name() -> None:
    assert message_class('std_msgs/msg/String') is String


@pytest.mark.parametrize(
    'kind',
    [
        'antigravity/msg/Fly',
        'evil/msg/Payload',
        'evil.msg/msg/Payload',
        '.evil/msg/Payload',
        'evil',
        'evil/msg/',
        'evil/srv/Payload',
        'std_msgs/msg/String/../Bool',
        'std_msgs/msg/__builtins__',
        'plain/msg/Function',
        '',
    ],
)
def test_nothing_else_is_imported(tmp_path, monkeypatch, kind) -> None:
    mark = tmp_path / 'was_imported'
    for name in ('evil', 'antigravity'):
        (tmp_path / name).mkdir()
        (tmp_path / name / '__init__.py').write_text(f'open({str(mark)!r}, "w")')
    (tmp_path / 'plain' / 'msg').mkdir(parents=True)
    (tmp_path / 'plain' / '__init__.py').touch()
    (tmp_path / 'plain' / 'msg' / '__init__.py').write_text('def Function(): pass')
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError, match=r'is no type of messages|cannot be imported'):
        message_class(kind)
    assert not mark.exists()
    assert not {'evil', 'antigravity'} & sys.modules.keys()
