"""What a core value is when it comes back out of its message: the same, to the last bit."""

from dataclasses import asdict, replace
import platform

import cv2
from diagnostic_msgs.msg import DiagnosticStatus
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
import numpy as np
import pytest
from rclpy.serialization import serialize_message
from rosbags.typesys import get_typestore, Stores
from servo_states import EVENTS, in_phase, MEMORY, PHASES, sight

from visual_servo_epipolar import __version__
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.estimate.odometry import Odometry
from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.laws.registry import phase_words, sentence
from visual_servo_epipolar.core.laws.two_steps import TWO_STEPS
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import updated
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.messages import event_log, read, settings_text, write
from visual_servo_epipolar.messages.diagnostics import diagnosis, markers
from visual_servo_epipolar.nodes.tracker_node import TrackerNode
from visual_servo_epipolar.simulation.closed_loop import published

STAMP_NS = 12_345_678_901
TYPES = get_typestore(Stores.ROS2_JAZZY)
finite = st.floats(-1e6, 1e6)
CAMERAS = [
    Camera(1280, 1024, 769.2307692307693, 768.1, 635.0, 512.0),
    Camera(640, 480, 400.1, 400.2, 320.3, 240.4, (0.1, -0.02, 1e-3, -1e-4, 0.03)),
    Camera(
        640, 480, 400.1, 400.2, 320.3, 240.4, tuple(1e-3 * np.arange(8)), 'rational_polynomial'
    ),
]


@st.composite
def feature_sets(draw: st.DrawFn) -> Features:
    count = draw(st.integers(0, 5))
    pixels = arrays(np.float64, (count, 2), elements=finite)
    whole = arrays(np.int64, count, elements=st.integers(0, 2**32 - 1))
    return Features(
        ids=draw(whole),
        current=draw(pixels),
        desired=draw(pixels),
        ages=draw(whole),
        errors=draw(arrays(np.float64, count, elements=finite)),
    )


def from_bag(message):
    """Return ``message`` as rosbags reads it from a bag."""
    name = f'{type(message).__module__.split(".")[0]}/msg/{type(message).__name__}'
    return TYPES.deserialize_cdr(serialize_message(message), name)


def assert_same_features(actual: Features, expected: Features) -> None:
    for name in ('ids', 'current', 'desired', 'ages', 'errors'):
        np.testing.assert_array_equal(getattr(actual, name), getattr(expected, name), name)


@given(value=feature_sets())
def test_features_come_back_exactly(value: Features) -> None:
    message = write.features(value, STAMP_NS, 'camera')
    for delivered in (message, from_bag(message)):
        assert_same_features(read.features(delivered), value)


def test_rows_that_the_photograph_does_not_show_are_left_out() -> None:
    """Earlier trackers could publish them, with nan for where the photograph has them."""
    value = Features([1, 2], np.ones((2, 2)), np.ones((2, 2)), [0, 0], [0.0, 0.0])
    message = write.features(value, STAMP_NS, 'camera')
    rows = np.frombuffer(message.data, write.TRACK_LAYOUT)
    rows['desired_u'][1] = rows['desired_v'][1] = np.nan
    assert read.features(message).ids.tolist() == [1]


def test_tracks_of_another_byte_order_are_read_right() -> None:
    value = Features(
        ids=[3, 70000], current=[[1.5, 2.5], [3, 4]], desired=[[5, 6], [7, 8]], ages=[1, 2],
        errors=[0.1, 0.2],
    )  # fmt: skip
    message = write.features(value, STAMP_NS, 'camera')
    rows = np.frombuffer(bytes(message.data), write.TRACK_LAYOUT)
    swapped = rows.astype(write.TRACK_LAYOUT.newbyteorder('>'))
    del message.data[:]
    message.data.frombytes(swapped.tobytes())
    message.is_bigendian = True
    assert_same_features(read.features(message), value)


@pytest.mark.parametrize('camera', CAMERAS, ids=lambda camera: f'{len(camera.distortion)} numbers')
def test_a_camera_comes_back_exactly(camera: Camera) -> None:
    message = write.camera_info(camera, STAMP_NS, 'camera')
    assert read.camera(message) == read.camera(from_bag(message)) == camera


@given(x=finite, y=finite, theta=st.floats(-3.14, 3.14))
def test_a_pose_comes_back_as_the_simulation_in_memory_has_it(x, y, theta) -> None:
    message = write.odometry(Pose(x, y, theta), Twist(0.0, 0.0), STAMP_NS, 'world', 'base')
    assert read.pose(message) == published(Pose(x, y, theta)) == read.pose(from_bag(message))
    assert read.pose(message).theta == pytest.approx(theta, abs=1e-15)


@given(theta=st.floats(-3.14, 3.14), pitch=st.floats(-0.5, 0.5), rate=finite)
def test_a_body_that_nods_has_the_heading_of_one_that_does_not(theta, pitch, rate) -> None:
    still = Twist(0.0, 0.0)
    message = write.odometry(
        Pose(0.0, 0.0, theta), still, STAMP_NS, 'world', 'base', pitch=(pitch, rate)
    )
    assert read.pose(message).theta == pytest.approx(theta, abs=1e-12)
    assert read.pitch(from_bag(message)) == pytest.approx((pitch, rate), abs=1e-12)


@given(linear=finite, angular=finite)
def test_a_twist_comes_back_exactly(linear, angular) -> None:
    twist = Twist(linear, angular)
    assert read.twist(write.twist(twist)) == twist
    assert read.twist(from_bag(write.twist_stamped(twist, STAMP_NS, 'base'))) == twist
    assert write.twist(Twist(np.float32(0.5), np.int64(-3))) == write.twist(Twist(0.5, -3.0))


@given(stamp_ns=st.integers(0, 2**31 * 10**9 - 1))
def test_a_stamp_comes_back_exactly(stamp_ns) -> None:
    assert read.stamp_ns(write.header(stamp_ns, '')) == stamp_ns


@pytest.mark.parametrize('columns', [slice(None), slice(None, None, -2)], ids=['whole', 'view'])
def test_an_image_comes_back_as_it_looks(columns: slice) -> None:
    pixels = np.random.default_rng(1).integers(0, 256, (5, 7), dtype=np.uint8)[:, columns]
    message = write.image(pixels, 'mono8', STAMP_NS, 'camera')
    for delivered in (message, from_bag(message)):
        np.testing.assert_array_equal(read.gray(delivered), pixels)


def test_named_numbers_come_back_with_nan() -> None:
    values = {'a_px': 1.5, 'b': float('nan')}
    actual = read.telemetry(write.telemetry(values, STAMP_NS, 'camera'))
    assert list(actual) == ['a_px', 'b']
    np.testing.assert_array_equal(list(actual.values()), list(values.values()))


def test_diagnostics_come_back_as_text() -> None:
    values = {'phase': 'holding', 'features': 3.0}
    message = write.diagnostics('servo', level=b'\x00', summary='', values=values, stamp_ns=1)
    assert read.diagnosis(from_bag(message)) == {'phase': 'holding', 'features': '3.0'}


@pytest.mark.parametrize(('sec', 'nanosec'), [(2**31 - 1, 2**32 - 1), (-(2**31), 0), (-1, 5)])
def test_a_stamp_that_no_clock_shows_is_passed_on_all_the_same(sec, nanosec) -> None:
    header = write.header(0, 'camera')
    header.stamp.sec, header.stamp.nanosec = sec, nanosec
    stamp = write.stamp(read.stamp_ns(header))
    assert stamp.sec == sec
    assert stamp.nanosec == min(nanosec, 10**9 - 1)


STEP_1 = 'zeroing_epipoles: the robot drives onto the axis of the photograph (step 1)'


@pytest.mark.parametrize(
    ('seen', 'refuted', 'words'),
    [
        ({}, '', ''),
        ({'features': 8, 'carried': True}, '', '8 features in view, by the memory of views'),
        ({}, 'odometry leaps', 'odometry leaps'),
    ],
)
def test_few_features_and_refuted_odometry_are_a_warning(seen, refuted, words) -> None:
    state = in_phase(Phase.ZEROING_EPIPOLES, measurement=sight(**seen), memory=MEMORY)
    state = state.changed(odometry=Odometry(refuted=refuted))
    message = diagnosis(state, 1, name='servo')
    status, level = message.status[0], DiagnosticStatus.WARN if words else DiagnosticStatus.OK
    assert (status.level, status.message) == (level, '; '.join(filter(None, [STEP_1, words])))
    assert read.diagnosis(message)['odometry'] == refuted


@pytest.mark.parametrize('phase', PHASES)
def test_what_a_phase_does_is_a_sentence(phase: Phase) -> None:
    reasons = [event for (_, event), then in TWO_STEPS.transitions.items() if then is phase]
    for reason in ('', *(event.value for event in reasons if event.sentence)):
        text = sentence(phase, reason)
        assert text.startswith(f'{phase.value}: ') and len(text.split()) >= 4
        assert not reason or not text.endswith(f' {reason}')
    assert phase_words(phase.value)


def test_an_event_that_is_a_reason_by_its_name_has_words() -> None:
    state = in_phase(Phase.DISPLACING, measurement=sight(), memory=MEMORY)
    status = diagnosis(state.changed(reason=Event.APART.value), 1, name='servo').status[0]
    assert status.message.endswith('; both epipoles can be trusted')
    with_own_reason = {Event.NOTHING, Event.LOST, Event.MISSED, Event.EXHAUSTED, Event.NO_GAIN}
    with_own_reason |= {Event.DIVERGED, Event.EXCURSION, Event.TIMED_OUT}
    with_own_reason |= {Event.DISOBEYED}
    assert with_own_reason == {event for event in EVENTS if not event.sentence}


def test_the_marker_of_a_phase_has_the_colour_of_its_row() -> None:
    words = markers(in_phase(Phase.DISPLACING), 1, 'camera').markers[0]
    assert words.text == 'displacing'
    colour = [round(255.0 * part) for part in (words.color.r, words.color.g, words.color.b)]
    assert bytes(colour).hex().upper() == TWO_STEPS.rows[Phase.DISPLACING].colour[1:]


@given(reason=st.text(), after=st.none() | st.integers(0, 2**63))
def test_an_entry_comes_back(reason: str, after: int | None) -> None:
    entry = event_log.Entry('lost', after, reason)
    assert event_log.from_text(event_log.to_text(entry)) == entry


@given(gain=st.floats(0.0, 5.0), after=st.none() | st.integers(0, 2**62))
def test_settings_come_back_to_the_last_bit(gain: float, after: int | None) -> None:
    settings = ServoSettings(k1=gain, law='paper')
    text = settings_text.to_text('/a/servo_node', [settings], after)
    node_settings = settings_text.from_text(text)
    assert (node_settings.node, node_settings.after_stamp_ns) == ('/a/servo_node', after)
    assert updated(ServoSettings(), node_settings.values, 'bag') == settings


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


EVENT, FILE = 'an event must be JSON with event', 'must be the parameter file of one node, got '
NO_EVENTS = '', '3', '{}', '{"event": "lost"}', '[' * 99_999, '{"event":1,"after_stamp_ns":"x"}'
NO_FILES = 'bot1: {servo_node: {k1: 1}}', '{', '3', '', '/servo_node: {k1: 1}', '{}', '[' * 99_999


@pytest.mark.parametrize(
    ('reader', 'text', 'words'),
    [
        *((event_log.from_text, text, EVENT) for text in NO_EVENTS),
        *((settings_text.from_text, text, FILE) for text in NO_FILES),
    ],
)
def test_any_other_text_is_refused(reader, text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        reader(text)
