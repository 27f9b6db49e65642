"""The camera of a run: another one stops the robot at once, and what is odd is said."""

from dataclasses import replace

import numpy as np
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo
from servo_rig import AWAY, CAMERA, PERIOD_NS, Rig, tracks, WORLD

from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.laws.standing import RESUMING_FRAMES
from visual_servo_epipolar.core.perception.lens_check import LensCheck
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.supervisor import Session
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
    assert rig.reason.startswith(CHANGED)
    for _ in range(3):
        rig.see()
    assert (rig.phase, set(rig.twists()[told:])) == ('holding', {STANDSTILL})
    assert rig.reason.startswith(CHANGED)
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
def test_a_driver_that_comes_late_is_heard_as_it_offers(
    bench, attentive, profile, watchdog
) -> None:
    node = bench.start(ServoNode, watchdog=watchdog)
    send = bench.talk(CameraInfo, 'camera_info', profile)

    def heard() -> bool:
        send(write.camera_info(CAMERA, 0, 'camera'))
        return node._camera.model is not None

    bench.until(heard, 'camera_info')


DISTRUST_S = 2.0  # as the servo has it
IMAGES = round(DISTRUST_S * 1e9 / PERIOD_NS) - 1


def flicker(rig: Rig) -> None:
    """Let another camera speak, and then the right one again."""
    for camera in (OTHER, CAMERA):
        rig.calibrate(write.camera_info(camera, rig.stamp_ns, 'camera'))
        rig.bench.settle()


def test_a_run_waits_after_a_word_of_another_camera(bench) -> None:
    rig = Rig(bench).drive()
    flicker(rig)
    count = len(rig.commands)
    for _ in range(IMAGES):
        rig.see()
    assert rig.phase == 'holding'
    assert 'camera_info has changed in mid-run' in rig.reason
    assert all(twist == STANDSTILL for twist in rig.twists()[count:])
    rig.drive()


def test_a_new_run_does_not_wait(bench) -> None:
    rig = Rig(bench, stale_timeout=5.0).drive()  # also where the machine stands still
    flicker(rig)
    rig.run.reset()
    rig.drive()


STILL = 8  # images of one view: 0.73 s, stale_timeout is 0.5 s


def hang(rig: Rig) -> None:
    """Show the same for a while, with new stamps."""
    for number in range(1, STILL + 1):
        features = WORLD.observe(AWAY, 0)
        rig.tell(write.features(features, rig.stamp_ns, 'camera_optical_frame', repeats=number))
        rig.stamp_ns += PERIOD_NS


def test_a_view_that_stands_still_while_the_robot_drives_stops_it(bench) -> None:
    rig = Rig(bench).drive()
    hang(rig)
    assert rig.phase == 'holding'
    assert 'the very same for' in rig.reason
    assert rig.twists()[-1] == STANDSTILL


def test_no_drive_begins_anew_by_the_view_that_stands_still(bench) -> None:
    rig = Rig(bench).drive()
    hang(rig)
    count = len(rig.commands)
    hang(rig)
    assert rig.phase == 'holding'
    assert all(twist == STANDSTILL for twist in rig.twists()[count:])


def test_a_view_that_changes_again_is_driven_by(bench) -> None:
    rig = Rig(bench).drive()
    hang(rig)
    for _ in range(RESUMING_FRAMES):
        assert rig.phase == 'holding'
        rig.see()
    assert rig.phase != 'holding'


def test_a_robot_that_stands_may_see_the_same_for_as_long_as_it_likes(bench) -> None:
    rig = Rig(bench, autostart=False)
    for _ in range(3):
        hang(rig)
    assert bench.call('servo_node/start').success
    rig.drive()


def show(rig: Rig, back: int) -> None:
    """Show an image that came last so many images ago, with a new stamp."""
    features = WORLD.observe(AWAY, 0)
    rig.tell(write.features(features, rig.stamp_ns, 'camera_optical_frame', back=back))
    rig.stamp_ns += PERIOD_NS


def test_an_image_of_another_time_stops_the_robot(bench) -> None:
    rig = Rig(bench).drive()
    rig.see()
    show(rig, 7)
    assert rig.phase == 'holding'
    assert 'of another time of the run' in rig.reason
    assert rig.twists()[-1] == STANDSTILL


def test_new_images_are_driven_by_again_only_after_a_while(bench) -> None:
    rig = Rig(bench).drive()
    rig.see()
    show(rig, 7)
    count = len(rig.commands)
    for _ in range(round(DISTRUST_S * 1e9 / PERIOD_NS) - 1):
        rig.see()
    assert all(twist == STANDSTILL for twist in rig.twists()[count:])
    rig.drive()


def test_a_robot_that_stands_may_see_what_came_before(bench) -> None:
    rig = Rig(bench, autostart=False)
    show(rig, 7)
    assert bench.call('servo_node/start').success
    rig.drive()


def test_the_last_image_once_more_is_none_of_another_time(bench) -> None:
    rig = Rig(bench).drive()
    show(rig, 1)
    assert rig.phase != 'holding'
