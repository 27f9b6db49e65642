"""The nodes and camera_info: rectified images, doubtful lenses, a camera that changes."""

import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from servo_rig import AWAY, CAMERA, PERIOD_NS, Rig

from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.tracker_node import TrackerNode
from visual_servo_epipolar.simulation.mounts.mounting import FixedRig
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld

OTHER = Camera(1280, 1024, 700.0, 700.0, 635.0, 512.0)
FISHEYE = Equidistant(1280, 1024, 400.0, 400.0, 639.5, 511.5)
FOLDING = Camera(1280, 1024, 500.0, 500.0, 635.0, 512.0, (-0.4, 0.0, 0.0, 0.0))


class Servo(Rig):
    """A servo node that hears a camera and tracks of it, one after the other."""

    def __init__(self, bench, camera=CAMERA, **values) -> None:
        super().__init__(bench, stale_timeout=60.0, calibrated=False, **values)
        self.world = PointWorld(PointSettings(), FixedRig(camera), seed=0)
        self.hear(write.camera_info(camera, 0, 'camera'))

    def hear(self, info) -> None:
        """Send a camera_info, and wait until the node has it."""
        self.calibrate(info)
        self.bench.settle()

    def show(self, features=None) -> None:
        """Send tracks, and wait until the node has taken them in."""
        features = self.world.observe(AWAY, 0) if features is None else features
        self.tell(write.features(features, self.stamp_ns, 'camera'))
        self.stamp_ns += PERIOD_NS

    @property
    def model(self):
        return self.node._camera.model


def driving(bench, **values) -> Servo:
    servo = Servo(bench, **values)
    while servo.twist == STANDSTILL:
        servo.show()
    return servo


def test_another_camera_begins_a_new_run_after_a_reset(bench) -> None:
    servo = driving(bench)
    servo.hear(write.camera_info(OTHER, 0, 'camera'))
    bench.call('servo_node/reset')
    servo.world = PointWorld(PointSettings(), FixedRig(OTHER), seed=0)
    servo.show()
    assert servo.twist != STANDSTILL


def test_a_robot_with_a_fisheye_drives(bench) -> None:
    driving(bench, camera=FISHEYE)
    assert not bench.logged('left out')


def test_features_that_the_lens_cannot_place_are_said(bench) -> None:
    servo = Servo(bench, FOLDING)
    bench.until(lambda: bench.logged('cannot be undone in'), 'the doubt about the lens')
    pixels = np.random.default_rng(0).uniform(0.0, 1.0, (60, 2)) * [1279.0, 1023.0]
    numbers = np.arange(60)
    servo.show(Features(numbers, pixels, pixels, numbers, np.zeros(60)))
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
    assert servo.model == Camera(1280, 1024, 450.0, 450.0, 635.0, 512.0)


CROP = Camera(1280, 1024, 769.2, 769.2, 200.0, 512.0)


@pytest.mark.parametrize('cropped', [False, True])
def test_a_principal_point_at_the_side_is_that_of_a_crop_alone(bench, cropped) -> None:
    show, clouds = bench.talk(Image, 'image_raw'), bench.listen(PointCloud2, 'tracks')
    bench.start(TrackerNode, cropped=cropped)
    servo = Servo(bench, CROP, cropped=cropped)
    show(write.image(np.zeros((1024, 1280), np.uint8), 'mono8', 1, 'camera'))
    bench.until(lambda: clouds, 'the tracks')
    assert servo.model == (CROP if cropped else None)
    for text in ('cannot be used, the robot stands', 'or say that the image is a crop (cropped)'):
        if not cropped:
            bench.until(lambda text=text: bench.logged(text), text)
        assert cropped is not bool(bench.logged(text))


SKEWED = (
    Camera(1280, 1024, 769.2, 769.2, 635.0, 512.0, skew=4.0),
    Equidistant(1280, 1024, 400.0, 400.0, 639.5, 511.5, (0.01, 0.0, 0.0, 0.0), skew=-1e-13),
)


@pytest.mark.parametrize('camera', SKEWED)
def test_skew_of_camera_info_is_taken(bench, camera) -> None:
    servo = Servo(bench)
    servo.hear(write.camera_info(camera, 0, 'camera'))
    assert servo.model == camera


@pytest.mark.parametrize('rectified', [False, True])
def test_images_that_sound_rectified_are_complained_of(bench, rectified) -> None:
    from rclpy.node import Node

    class Remapped(TrackerNode):
        def resolve_topic_name(self, topic, *, only_expand=False):
            name = Node.resolve_topic_name(self, topic, only_expand=only_expand)
            return name.replace('image_raw', 'image_rect')

    calibrate = bench.talk(CameraInfo, 'camera_info')
    bench.talk(Image, 'image_raw')
    bench.start(Remapped, rectified=rectified)
    calibrate(write.camera_info(FOLDING, 0, 'camera'))
    bench.settle()
    bench.settle()
    assert bool(bench.logged('/image_rect sounds rectified')) is not rectified
