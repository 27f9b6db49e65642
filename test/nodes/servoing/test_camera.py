"""The camera of a run: another one stops the robot at once, and what is odd is said."""

from dataclasses import replace

import numpy as np
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo
from servo_rig import CAMERA, Rig, tracks

from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.perception.lens_check import LensCheck
from visual_servo_epipolar.core.servo.session import Session
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.nodes.servoing.camera import ServoCamera
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings
from visual_servo_epipolar.nodes.tracking import camera_subscriptions

OTHER = replace(CAMERA, fx=1000.0, fy=1000.0)
CHANGED = 'camera_info has changed in mid-run: fx 769.2 -> 1000, fy 769.2 -> 1000, rays'


def test_another_camera_in_mid_run_stops_the_robot_at_once_and_for_good(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0).drive()
    told = len(rig.commands)
    rig.calibrate(write.camera_info(OTHER, rig.stamp_ns, 'camera'))
    bench.until(lambda: len(rig.commands) > told, 'the zero twist')
    assert (rig.phase, rig.twists()[told:]) == ('holding', [STANDSTILL])
    assert rig.node._state.reason.startswith(CHANGED)
    for _ in range(3):
        rig.see()
    assert (rig.phase, set(rig.twists()[told:])) == ('holding', {STANDSTILL})
    assert rig.node._state.reason.startswith(CHANGED)
    bench.until(lambda: bool(bench.logged(CHANGED)), 'the complaint')


def test_tracks_that_are_refused_are_complained_about(bench) -> None:
    rig = Rig(bench, stale_timeout=60.0)
    cloud = tracks(stamp_ns=rig.stamp_ns)
    np.frombuffer(cloud.data, write.TRACK_LAYOUT)['u'][3] = 1e300
    rig.tell(cloud)
    bench.until(lambda: bool(bench.logged('tracks refused: 1 of 60 features lie')), 'the reason')


@pytest.mark.parametrize(('camera', 'doubted'), [(CAMERA, True), (OTHER, False)])
def test_what_contradicts_a_camera_does_not_outlive_it(bench, camera, doubted) -> None:
    servo = ServoCamera(bench.probe, ServoNodeSettings(), print)
    settings = ServoSettings()
    servo.hear(write.camera_info(CAMERA, 0, 'camera'), Session(), settings)
    servo._lens_check = LensCheck(doubt='the tracks contradict camera_info')
    servo.hear(write.camera_info(camera, 0, 'camera'), Session(), settings)
    assert bool(servo._lens_check.doubt) == doubted


FISHEYE = Equidistant(1280, 1024, 400.0, 400.0, 635.0, 512.0, (0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ('camera', 'deviation', 'wrong'),
    [(FISHEYE, 0.1, True), (FISHEYE, 0.0, False), (CAMERA, 0.1, False)],
)
def test_a_focal_deviation_is_of_a_pinhole_alone(bench, camera, deviation, wrong) -> None:
    said: list[str] = []
    servo = ServoCamera(bench.probe, ServoNodeSettings(), said.append)
    settings = ServoSettings(focal_deviation=deviation)
    servo.hear(write.camera_info(camera, 0, 'camera'), Session(), settings)
    assert any('focal_deviation is of a pinhole' in text for text in said) == wrong


@pytest.fixture
def attentive(monkeypatch) -> None:
    monkeypatch.setattr(camera_subscriptions, 'LOOK_PERIOD_S', 0.02)


@pytest.mark.parametrize('word', ['auto', 'reliable'])
def test_a_camera_info_that_was_latched_before_is_heard(bench, attentive, word) -> None:
    bench.talk(CameraInfo, 'camera_info', qos.LATCHED)(write.camera_info(CAMERA, 0, 'camera'))
    node = bench.start(ServoNode, camera_reliability=word)
    bench.until(lambda: node._camera.model is not None, 'the camera_info of before')


@pytest.mark.parametrize('watchdog', [True, False])
@pytest.mark.parametrize(
    'profile',
    [QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT), qos.STREAM, qos.LATCHED],
)
def test_a_driver_that_comes_later_is_heard_in_the_way_it_offers(
    bench, attentive, profile, watchdog
) -> None:
    node = bench.start(ServoNode, watchdog=watchdog)
    send = bench.talk(CameraInfo, 'camera_info', profile)

    def heard() -> bool:
        send(write.camera_info(CAMERA, 0, 'camera'))
        return node._camera.model is not None

    bench.until(heard, 'camera_info')
