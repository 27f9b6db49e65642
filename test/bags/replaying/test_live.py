"""A run that is interrupted as on a robot: orders, silence, new gains; its replay is the same."""

from bagmaker import decoded, Message, new_listener, replayed, write_bag
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from servo_rig import CAMERA, PERIOD_NS, REPLAYED, Rig
from std_msgs.msg import String

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.laws.standing import RESUMING_FRAMES
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import driving_inputs, qos
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.nodes.tracker_node import TrackerNode


class Robot:
    """Servo, or tracker and servo in wall time, fed with the messages of a run one by one."""

    def __init__(self, bench, run: list[Message], *, by_images: bool = False) -> None:
        self.bench = bench
        listener, self.received = new_listener(bench.context)
        bench.add(listener)
        kind, topic = (Image, '/image_raw') if by_images else (PointCloud2, '/tracks')
        self.talk, calibrate = bench.talk(kind, topic), bench.talk(CameraInfo, '/camera_info')
        reliable = {'camera_reliability': 'reliable'} if by_images else {}
        if by_images:
            bench.start(TrackerNode, **reliable)
        self.servo = bench.start(ServoNode, **REPLAYED, **reliable)
        self.messages = [item[2] for item in run if item[0] == topic]
        calibrate(next(item[2] for item in run if item[0] == '/camera_info'))
        bench.settle()

    def see(self, first: int, end: int) -> None:
        for raw in self.messages[first:end]:
            self.talk(raw)
            self.bench.settle()

    def call(self, service: str) -> None:
        assert self.bench.call(service).success
        self.bench.settle()

    def set_parameter(self, name: str, value: float) -> None:
        self.servo.set_parameters([Parameter(name, value=value)])


def test_stop_start_and_reset_are_replayed_where_they_happened(bench, small_run, tmp_path) -> None:
    robot = Robot(bench, small_run)
    robot.see(0, 5)
    robot.call('servo_node/stop')
    robot.see(5, 7)  # heard, not acted on
    robot.call('servo_node/start')
    robot.see(7, 12)
    robot.call('servo_node/reset')
    robot.see(12, 16)
    robot.set_parameter('max_speed_ratio', 0.5)
    robot.see(16, 20)
    _, steps, comparison = replayed(write_bag(tmp_path / 'orders', robot.received))
    assert len(steps) == 18
    assert comparison.equal, comparison.divergence
    remaining = [item for item in robot.received if item[0] != '/servo_node/events']
    assert not replayed(write_bag(tmp_path / 'without', remaining)).comparison.equal


def test_silence_is_replayed_where_it_fell(bench, small_run, tmp_path) -> None:
    robot = Robot(bench, small_run)
    phases = bench.listen(String, 'phase', qos.LATCHED)
    robot.see(0, 5)
    robot.set_parameter('stale_timeout', 0.05)
    bench.until(lambda: phases[-1].data == 'holding', 'the watchdog')
    robot.set_parameter('stale_timeout', 60.0)
    robot.see(5, 12)
    events = [decoded(item).data for item in robot.received if item[0] == '/servo_node/events']
    assert any('"lost"' in text and 'no new tracks for' in text for text in events)
    _, steps, comparison = replayed(write_bag(tmp_path / 'silence', robot.received))
    assert len(steps) == 12
    assert comparison.equal, comparison.divergence


def test_a_photograph_on_the_way_and_redetection_are_replayed(bench, small_run, tmp_path) -> None:
    robot = Robot(bench, small_run, by_images=True)
    robot.see(40, 41)  # nothing to come back to yet; one image: the next would be of another view
    robot.call('tracker_node/capture_desired')
    robot.see(41, 46)
    robot.call('tracker_node/redetect')
    robot.see(46, 50)
    path = write_bag(tmp_path / 'taught', robot.received)
    _, steps, comparison = replayed(path)
    assert len(steps) == 10
    assert [step.telemetry['features'] > 20 for step in steps] == [False] + [True] * 9
    assert comparison.equal, comparison.divergence
    assert replayed(path, from_tracks=True).comparison.equal


OTHER = Camera(1280, 1024, 700.0, 700.0, 635.0, 512.0)
CROP = Camera(1280, 1024, 769.2, 769.2, 300.0, 512.0)
RAW = Camera(1280, 1024, 760.0, 760.0, 640.0, 500.0, (-0.2, 0.05, 0.0, 0.0))


def recorded(bench, cameras: list[Camera], **values) -> list[Message]:
    """Return all that a servo says and hears which is given one camera_info after the other."""
    listener, received = new_listener(bench.context)
    bench.add(listener)
    rig = Rig(bench, calibrated=False, **values)
    for camera in cameras:
        message = write.camera_info(camera, rig.stamp_ns, 'camera')
        if values.get('rectified'):
            message.p = write.camera_info(CAMERA, 0, '').p
        rig.hear(message)
        rig.see()
    return received


def test_a_camera_changed_in_mid_run_holds_in_the_replay(bench, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(driving_inputs, 'DISTRUST_S', 1.5e-9 * PERIOD_NS)  # the first is refused
    messages = recorded(bench, [CAMERA] * 4 + [OTHER] * 4 + [CAMERA] * 4)
    _, steps, comparison = replayed(write_bag(tmp_path / 'bag', messages))
    assert comparison.equal
    phases = [step.phase.value for step in steps]
    held = 4 + RESUMING_FRAMES - 1
    assert phases[3 : 5 + held] == ['displacing', *['holding'] * held, 'displacing']


@pytest.mark.parametrize('known', [True, False])
@pytest.mark.parametrize(('option', 'camera'), [('rectified', RAW), ('cropped', CROP)])
def test_what_images_are_is_replayed_as_recorded_or_as_said(
    bench, tmp_path, option, camera, known
) -> None:
    messages = recorded(bench, [camera] * 4, **{option: True})
    if not known:
        messages = [item for item in messages if item[0] != '/servo_node/settings']
    path = write_bag(tmp_path / 'bag', messages)
    changes = {'servo': {'autostart': True}}
    assert replayed(path, **{option: not known}, changes=changes).comparison.equal
    if not known and option == 'rectified':
        assert not replayed(path, changes=changes).comparison.equal
    elif not known:
        with pytest.raises(InputError, match='camera_info cannot be used: the principal point'):
            replayed(path, changes=changes)
