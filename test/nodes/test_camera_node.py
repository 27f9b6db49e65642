"""The simulated camera as a node: images that belong to the ground truth they were taken at."""

from nav_msgs.msg import Odometry
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, Image

from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL
from visual_servo_epipolar.core.stamps import period_ns
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.camera_node import CameraNode
from visual_servo_epipolar.simulation.closed_loop import published
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.view import LEVEL, Nod

TINY = {
    'width': 64,
    'height': 48,
    'focal_length': 40.0,
    'principal_u': 31.25,
    'principal_v': 23.5,
}
PERIOD_NS = period_ns(11.0)
POSE = Pose.from_start(0.3, -2.2, 5.0)


class Camera:
    """A running camera node, told where the robot is message by message."""

    def __init__(self, bench, **values) -> None:
        self.bench = bench
        self.images = bench.listen(Image, 'image_raw')
        self.infos = bench.listen(CameraInfo, 'camera_info')
        self._truth = bench.talk(Odometry, 'ground_truth')
        self.node = bench.start(CameraNode, **{**TINY, **values})

    def stamps(self) -> list[int]:
        return [read.stamp_ns(message.header) for message in self.images]

    def see(self, stamp_ns, pose=POSE) -> None:
        self.tell(write.odometry(pose, STANDSTILL, stamp_ns, 'world', 'base_link'))

    def tell(self, message) -> None:
        """Publish ground truth, and wait until the node has dealt with it."""
        self._truth(message)
        self.bench.settle()

    @property
    def simulator(self):
        """The same simulation as that of the node."""
        return self.node._simulator


@pytest.fixture
def camera(bench):
    return Camera(bench)


def test_image_and_camera_info_carry_the_stamp_of_the_truth(camera) -> None:
    camera.see(123_456_789)
    assert camera.stamps() == [123_456_789]
    assert [read.stamp_ns(message.header) for message in camera.infos] == [123_456_789]
    assert camera.images[0].header.frame_id == camera.infos[0].header.frame_id
    assert camera.images[0].header.frame_id.endswith('_optical_frame')


def test_the_image_is_what_the_simulation_sees_from_there(camera) -> None:
    camera.see(0)
    expected = camera.simulator.capture(published(POSE), 0)
    np.testing.assert_array_equal(read.gray(camera.images[0]), expected)


def test_intrinsics_are_those_of_the_settings(bench) -> None:
    distortion = (0.1, -0.01, 0.001, 0.002, 0.0)
    camera = Camera(bench, distortion=distortion)
    camera.see(0)
    info = camera.infos[0]
    assert (info.width, info.height) == (64, 48)
    assert list(info.k) == [40.0, 0.0, 31.25, 0.0, 40.0, 23.5, 0.0, 0.0, 1.0]
    assert list(info.p) == [40.0, 0.0, 31.25, 0.0, 0.0, 40.0, 23.5, 0.0, 0.0, 0.0, 1.0, 0.0]
    assert (info.distortion_model, tuple(info.d)) == ('plumb_bob', distortion)
    assert (camera.images[0].width, camera.images[0].height) == (64, 48)


@pytest.mark.parametrize(
    ('model', 'distortion'),
    [
        ('equidistant', (-0.01, 0.002, 0.0, 0.0)),
        ('rational_polynomial', (0.2, 0.02, 0.001, -0.002, 0.001, 0.3, 0.05, 0.002)),
    ],
)
def test_every_lens_is_told_as_it_is_simulated(bench, model, distortion) -> None:
    camera = Camera(bench, distortion_model=model, distortion=distortion)
    camera.see(0)
    info = camera.infos[0]
    assert (info.distortion_model, tuple(info.d)) == (model, distortion)
    assert read.camera(info) == camera.simulator.camera


def test_no_distortion_may_be_written_as_an_empty_list(bench) -> None:
    camera = Camera(bench, distortion=())
    camera.see(0)
    assert read.camera(camera.infos[0]) == CameraSettings(**TINY, distortion=()).camera


def test_who_comes_late_still_gets_the_photograph(camera) -> None:
    camera.see(0)
    photographs = camera.bench.listen(Image, 'desired/image_raw', qos.LATCHED)
    camera.bench.until(lambda: bool(photographs), 'the photograph')
    np.testing.assert_array_equal(read.gray(photographs[0]), camera.simulator.photograph())


def test_an_image_is_taken_only_when_a_frame_has_passed(camera) -> None:
    for stamp_ns in (0, 10_000_000, PERIOD_NS - 1, PERIOD_NS, PERIOD_NS + 1, 2 * PERIOD_NS):
        camera.see(stamp_ns)
    assert camera.stamps() == [0, PERIOD_NS, 2 * PERIOD_NS]


def test_lateness_does_not_add_up(camera) -> None:
    late_ns = 7_000_000
    stamps = [0, PERIOD_NS + late_ns, 2 * PERIOD_NS + late_ns // 2, 3 * PERIOD_NS]
    for stamp_ns in stamps:
        camera.see(stamp_ns)
    assert camera.stamps() == stamps


def test_it_goes_on_when_time_runs_backwards(camera) -> None:
    for stamp_ns in (100 * PERIOD_NS, 0, PERIOD_NS):
        camera.see(stamp_ns)
    assert camera.stamps() == [100 * PERIOD_NS, 0, PERIOD_NS]


def test_an_image_that_is_late_is_stamped_when_it_comes(bench) -> None:
    camera = Camera(bench, stamp_delay=1.5 * PERIOD_NS * 1e-9)
    for number in range(4):
        camera.see(number * PERIOD_NS)
    assert camera.stamps() == [2 * PERIOD_NS, 3 * PERIOD_NS]


def test_the_image_leans_with_the_body_of_the_truth(camera) -> None:
    nod = Nod(0.1, 0.2)
    camera.tell(write.odometry(POSE, STANDSTILL, 0, 'world', 'base_link', pitch=nod))
    simulator, images = camera.simulator, []
    for body in (LEVEL, nod):
        simulator.move(STANDSTILL, body)
        images.append(simulator.capture(published(POSE), 0))
    np.testing.assert_array_equal(read.gray(camera.images[0]), images[1])
    assert (images[0] != images[1]).mean() > 0.3


def test_bgr8_is_the_same_picture_in_colour(bench) -> None:
    camera = Camera(bench, encoding='bgr8')
    camera.see(0)
    assert (camera.images[0].encoding, camera.images[0].step) == ('bgr8', 3 * 64)
    expected = camera.simulator.capture(published(POSE), 0)
    np.testing.assert_array_equal(read.gray(camera.images[0]), expected)


def test_a_pose_that_is_not_finite_is_refused_and_the_next_one_seen(camera) -> None:
    message = write.odometry(POSE, STANDSTILL, 0, 'world', 'base_link')
    message.pose.pose.position.x = float('nan')
    camera.tell(message)
    camera.bench.until(lambda: camera.bench.logged('a pose must be finite'), 'the error logged')
    assert camera.images == []
    camera.see(PERIOD_NS)
    assert camera.stamps() == [PERIOD_NS]


def test_no_image_costs_settings_to_be_made_anew(bench, monkeypatch) -> None:
    camera = Camera(bench, rig='pan_tilt')
    monkeypatch.setattr(CameraSettings, '__post_init__', lambda _: pytest.fail('made anew'))
    camera.see(0)
    camera.see(PERIOD_NS)
    assert camera.stamps() == [0, PERIOD_NS]
    assert read.camera(camera.infos[-1]).width == TINY['width']
