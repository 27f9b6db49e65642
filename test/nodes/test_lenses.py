"""The nodes and camera_info: rectified images, doubtful lenses, a camera that changes."""

import math

import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import String

from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.nodes.servoing.camera import DISTRUST_S
from visual_servo_epipolar.nodes.tracker_node import TrackerNode
from visual_servo_epipolar.simulation.mounts.mounting import FixedRig
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld

CAMERA = Camera(1280, 1024, 769.2, 769.2, 635.0, 512.0)
OTHER = Camera(1280, 1024, 700.0, 700.0, 635.0, 512.0)
FISHEYE = Equidistant(1280, 1024, 400.0, 400.0, 639.5, 511.5)
FOLDING = Camera(1280, 1024, 500.0, 500.0, 635.0, 512.0, (-0.4, 0.0, 0.0, 0.0))
AWAY = Pose.from_start(1.0, -3.5, 8.0)
PERIOD_NS = 90_909_091


class Servo:
    """A servo node that hears a camera and tracks, one after the other."""

    def __init__(self, bench, camera=CAMERA, **values) -> None:
        self.bench, self.stamp_ns = bench, PERIOD_NS
        self.phases = bench.listen(String, 'phase')
        self._send = bench.talk(PointCloud2, 'tracks')
        self._calibrate = bench.talk(CameraInfo, 'camera_info')
        self.node = bench.start(
            ServoNode, autostart=True, stale_timeout=60.0, max_latency=0.0, **values
        )
        self.world = PointWorld(PointSettings(), FixedRig(camera), seed=0)
        self.calibrate(camera)

    def calibrate(self, camera) -> None:
        """Send a camera_info, and wait until the node has it."""
        self.hear(write.camera_info(camera, 0, 'camera'))

    def hear(self, info) -> None:
        self._calibrate(info)
        self.bench.settle()

    def see(self, features=None) -> None:
        """Send tracks, and wait until the node has taken them in."""
        features = self.world.observe(AWAY, 0) if features is None else features
        received = self.node.received
        self._send(write.features(features, self.stamp_ns, 'camera'))
        self.stamp_ns += PERIOD_NS
        self.bench.until(lambda: self.node.received > received, 'tracks to arrive')

    @property
    def state(self):
        return self.node._state


def driving(bench, **values) -> Servo:
    servo = Servo(bench, **values)
    while servo.state.twist == STANDSTILL:
        servo.see()
    return servo


def test_a_camera_that_changes_in_mid_run_stops_the_robot_for_good(bench) -> None:
    servo = driving(bench, holding_timeout=0.5)
    servo.calibrate(OTHER)
    assert (servo.state.phase.value, servo.state.twist) == ('holding', STANDSTILL)
    assert 'camera_info has changed in mid-run: fx 769.2 -> 700' in servo.state.reason
    for _ in range(8):
        servo.see()
        assert servo.state.twist == STANDSTILL
    assert servo.state.phase.value == 'failed'
    assert 'camera_info has changed in mid-run' in servo.state.reason
    bench.until(lambda: bench.logged('camera_info has changed'), 'the reason in the log')


def test_a_run_goes_on_with_the_camera_it_began_with(bench) -> None:
    servo = driving(bench)
    servo.calibrate(OTHER)
    servo.see()
    servo.calibrate(CAMERA)
    servo.see()
    assert servo.state.phase.value == 'holding'  # the two may speak in turns
    for _ in range(math.ceil(1e9 * DISTRUST_S / PERIOD_NS) + 1):
        servo.see()
    assert servo.state.phase.value != 'holding'
    servo.see()
    assert servo.state.twist != STANDSTILL


def test_another_camera_begins_a_new_run_after_a_reset(bench) -> None:
    servo = driving(bench)
    servo.calibrate(OTHER)
    bench.call('servo_node/reset')
    servo.world = PointWorld(PointSettings(), FixedRig(OTHER), seed=0)
    servo.see()
    assert servo.state.twist != STANDSTILL


def test_the_same_camera_again_is_no_change(bench) -> None:
    servo = driving(bench)
    for _ in range(3):
        servo.calibrate(CAMERA)
        servo.see()
        assert servo.state.twist != STANDSTILL


def test_a_robot_with_a_fisheye_drives(bench) -> None:
    servo = driving(bench, camera=FISHEYE)
    assert servo.node._camera.model == FISHEYE
    assert not bench.logged('left out')


def test_features_that_the_lens_cannot_place_are_said(bench) -> None:
    servo = Servo(bench, FOLDING)
    bench.until(lambda: bench.logged('cannot be undone in'), 'the doubt about the lens')
    pixels = np.random.default_rng(0).uniform(0.0, 1.0, (60, 2)) * [1279.0, 1023.0]
    numbers = np.arange(60)
    servo.see(Features(numbers, pixels, pixels, numbers, np.zeros(60)))
    bench.until(lambda: bench.logged('features are left out'), 'the share that is left out')
    said = bench.logged('features are left out')[0]
    lost = int((~FOLDING.round_trips(pixels, FOLDING.rays(pixels))).sum())
    assert said.startswith(f'{lost} of 60 features are left out')
    assert 'plumb_bob lens' in said


def test_of_rectified_images_p_holds(bench) -> None:
    info = write.camera_info(FOLDING, 0, 'camera')
    info.p[0] = info.p[5] = 450.0
    servo = Servo(bench, rectified=True)
    servo.hear(info)
    assert servo.node._camera.model == Camera(1280, 1024, 450.0, 450.0, 635.0, 512.0)


CROP = Camera(1280, 1024, 769.2, 769.2, 200.0, 512.0)


@pytest.mark.parametrize('cropped', [False, True])
def test_a_principal_point_at_the_side_is_that_of_a_crop_alone(bench, cropped) -> None:
    calibrate = bench.talk(CameraInfo, 'camera_info')
    servo = bench.start(ServoNode, cropped=cropped)
    tracker = bench.start(TrackerNode, cropped=cropped)
    calibrate(write.camera_info(CROP, 0, 'camera'))
    bench.until(lambda: tracker._camera or tracker._unusable, 'camera_info to arrive')
    if cropped:
        bench.until(lambda: servo._camera.model == CROP, 'camera_info to arrive')
    else:
        bench.until(lambda: bench.logged('cannot be used, the robot stands'), 'its refusal')
        assert servo._camera.model is None
        assert 'or say that the image is a crop (cropped)' in tracker._unusable


SKEWED = (
    Camera(1280, 1024, 769.2, 769.2, 635.0, 512.0, skew=4.0),
    Equidistant(1280, 1024, 400.0, 400.0, 639.5, 511.5, (0.01, 0.0, 0.0, 0.0), skew=-1e-13),
)


@pytest.mark.parametrize('camera', SKEWED)
def test_skew_of_camera_info_is_taken(bench, camera) -> None:
    servo = Servo(bench)
    servo.hear(write.camera_info(camera, 0, 'camera'))
    assert servo.node._camera.model == camera


@pytest.mark.parametrize('rectified', [False, True])
def test_images_that_sound_rectified_and_are_not_said_to_be_are_complained_of(
    bench, rectified
) -> None:
    from rclpy.node import Node

    class Remapped(TrackerNode):
        def resolve_topic_name(self, topic, *, only_expand=False):
            name = Node.resolve_topic_name(self, topic, only_expand=only_expand)
            return name.replace('image_raw', 'image_rect')

    calibrate = bench.talk(CameraInfo, 'camera_info')
    bench.talk(Image, 'image_raw')
    node = bench.start(Remapped, rectified=rectified)
    calibrate(write.camera_info(FOLDING, 0, 'camera'))
    bench.until(lambda: node._camera is not None, 'camera_info to arrive')
    bench.settle()
    assert bool(bench.logged('/image_rect sounds rectified')) is not rectified
