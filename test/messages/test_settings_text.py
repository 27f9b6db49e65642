"""Settings as text: they come back as they were, and a node takes the text as its parameters."""

from dataclasses import asdict, replace
import platform

import cv2
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from visual_servo_epipolar import __version__
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import from_mapping
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.messages import settings_text
from visual_servo_epipolar.nodes.tracker_node import TrackerNode


@given(gain=st.floats(0.0, 5.0), after=st.none() | st.integers(0, 2**62))
def test_settings_come_back_to_the_last_bit(gain: float, after: int | None) -> None:
    settings = ServoSettings(k1=gain, law='paper')
    text = settings_text.to_text('/a/servo_node', [settings], after)
    node_settings = settings_text.from_text(text)
    assert (node_settings.node, node_settings.after_stamp_ns) == ('/a/servo_node', after)
    assert from_mapping(ServoSettings, node_settings.values, 'bag') == settings


def test_a_node_says_what_it_runs_with_and_takes_it_as_parameters(bench, tmp_path) -> None:
    from std_msgs.msg import String

    from visual_servo_epipolar.nodes import qos

    node = bench.start(TrackerNode, max_features=50)
    received = bench.listen(String, 'tracker_node/settings', qos.LATCHED)
    bench.until(lambda: received, 'the settings, though they were published before')
    node_settings = settings_text.from_text(received[0].data)
    assert node_settings.node == node.get_fully_qualified_name()
    assert node_settings.after_stamp_ns is None
    expected = asdict(replace(TrackerSettings(), max_features=50))
    assert node_settings.values == {**node_settings.values, **expected}
    path = tmp_path / 'parameters.yaml'
    path.write_text(received[0].data)
    again = TrackerNode(context=bench.context, cli_args=['--ros-args', '--params-file', str(path)])
    bench.nodes.append(again)
    bench.until(lambda: len(received) == 2, 'the settings of the other')
    assert settings_text.from_text(received[1].data).values == node_settings.values


def test_settings_say_what_computed_with_them() -> None:
    text = settings_text.to_text('/servo_node', [ServoSettings()], 5)
    versions = settings_text.from_text(text).versions
    assert versions == {
        'visual_servo_epipolar': __version__,
        'Python': platform.python_version(),
        'numpy': np.__version__,
        'OpenCV': cv2.__version__,
    }
    earlier = '# visual_servo_epipolar: 0.0.1\n/servo_node: {ros__parameters: {k1: 0.1}}'
    assert settings_text.from_text(earlier).versions == {'visual_servo_epipolar': '0.0.1'}
    assert settings_text.from_text(earlier).version == '0.0.1'


def test_namespaces_may_be_nested() -> None:
    nodes = settings_text.sections('bot1: {servo_node: {ros__parameters: {k1: 0.2}}}')
    assert nodes == {'bot1/servo_node': {'k1': 0.2}}


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('bot1: {servo_node: {k1: 1}}', 'must stand under ros__parameters'),
        ('{', 'not YAML'),
        ('3', 'must map nodes'),
        ('/servo_node: {k1: 1}', 'must stand under ros__parameters'),
        ('{}', 'must be those of one node, got 0'),
        ('[' * 100_000, 'not YAML'),
    ],
)
def test_what_is_no_parameter_file_is_refused(text: str, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        settings_text.from_text(text)
