"""What a run goes by: another camera or photograph stops the robot, oddities are logged."""

from dataclasses import replace

from nav_msgs.msg import Odometry
import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from servo_rig import CAMERA, IN_VIEW, PERIOD_NS, Rig

from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL
from visual_servo_epipolar.core.servo.run import Run
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.telemetry import odometry_of
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import camera_subscriptions, qos
from visual_servo_epipolar.nodes.driving_inputs import ServoCamera
from visual_servo_epipolar.nodes.servo_node import MEANWHILE
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings
from visual_servo_epipolar.nodes.tracker_node import TrackerNode
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld
from visual_servo_epipolar.simulation.rigs import SimulatedRig

OTHER = replace(CAMERA, fx=1000.0, fy=1000.0)
CHANGED = 'camera_info has changed in mid-run: fx 769.2 -> 1000, fy 769.2 -> 1000, rays'


def test_another_camera_in_mid_run_stops_the_robot_at_once_and_for_good(bench) -> None:
    rig = Rig(bench).drive()
    told = len(rig.commands)
    rig.hear(OTHER)
    bench.until(lambda: len(rig.commands) > told, 'the zero twist')
    assert (rig.phase, rig.twists()[told:]) == ('holding', [STANDSTILL])
    assert rig.reason.startswith(CHANGED)
    rig.stand()
    assert rig.phase == 'holding'
    assert rig.reason.startswith(CHANGED)
    bench.until(lambda: bool(bench.logged(CHANGED)), 'the complaint')


FISHEYE = Equidistant(1280, 1024, 400.0, 400.0, 635.0, 512.0, (0.0, 0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ('camera', 'deviation', 'wrong'),
    [(FISHEYE, 0.1, True), (FISHEYE, 0.0, False), (CAMERA, 0.1, False)],
)
def test_a_focal_deviation_is_of_a_pinhole_alone(bench, camera, deviation, wrong) -> None:
    said: list[str] = []
    servo = ServoCamera(bench.probe, ServoNodeSettings(), said.append)
    settings = ServoSettings(focal_deviation=deviation)
    servo.hear(write.camera_info(camera, 0, 'camera'), Run(), settings)
    assert any('focal_deviation is of a pinhole' in text for text in said) == wrong


@pytest.fixture
def attentive(monkeypatch) -> None:
    monkeypatch.setattr(camera_subscriptions, 'LOOK_PERIOD_S', 0.02)


def test_a_driver_that_comes_late_is_heard_as_it_offers(bench, attentive) -> None:
    rig = Rig(bench, calibrated=False)
    rig.see()
    send = bench.talk(CameraInfo, 'camera_info', qos.IMAGES['best_effort'])
    message = write.camera_info(CAMERA, 0, 'camera')
    bench.until(lambda: bool(send(message) or rig.commands), 'a command')


DISTRUST_S = 2.0  # as the servo has it
IMAGES = round(DISTRUST_S * 1e9 / PERIOD_NS) - 1


def test_a_run_waits_after_a_message_of_another_camera(bench) -> None:
    rig = Rig(bench).drive()
    for camera in (OTHER, CAMERA):
        rig.hear(camera)
    rig.stand(IMAGES)
    assert rig.phase == 'holding'
    assert 'camera_info has changed in mid-run' in rig.reason
    rig.drive()


STILL = 8  # images of one view: 0.73 s, stale_timeout is 0.5 s


def hang(rig: Rig) -> None:
    """Show the same for a while, with new stamps."""
    for number in range(1, STILL + 1):
        rig.show(IN_VIEW, repeats=number)


def test_a_view_that_stands_still_stops_the_robot_until_it_changes(bench, clock) -> None:
    rig = Rig(bench, stale_timeout=0.5).drive()
    hang(rig)
    assert (rig.phase, rig.twist) == ('holding', STANDSTILL)
    assert 'the very same for' in rig.reason
    hang(rig)
    rig.resume()


def test_a_robot_that_stands_may_see_the_same_for_as_long_as_it_likes(bench, clock) -> None:
    rig = Rig(bench, autostart=False, stale_timeout=0.5)
    for _ in range(3):
        hang(rig)
    assert bench.call('servo_node/start').success
    rig.drive()


def test_an_image_of_another_time_stops_the_robot_for_a_while(bench) -> None:
    rig = Rig(bench).drive()
    rig.see()
    rig.show(IN_VIEW, back=7)
    assert (rig.phase, rig.twist) == ('holding', STANDSTILL)
    assert 'of another time of the run' in rig.reason
    rig.stand(IMAGES)
    rig.drive()


def test_the_last_image_once_more_is_none_of_another_time(bench) -> None:
    rig = Rig(bench).drive()
    rig.show(IN_VIEW, back=1)
    assert rig.phase != 'holding'


FOLDING = Camera(1280, 1024, 500.0, 500.0, 635.0, 512.0, (-0.4, 0.0, 0.0, 0.0))


def test_another_camera_begins_a_new_run_after_a_reset(bench) -> None:
    rig = Rig(bench).drive()
    rig.hear(OTHER)
    bench.call('servo_node/reset')
    rig.world = PointWorld(PointSettings(), SimulatedRig(OTHER), seed=0)
    rig.drive()


def test_a_robot_with_a_fisheye_drives(bench) -> None:
    Rig(bench, camera=FISHEYE).drive()
    assert not bench.logged('left out')


def test_features_that_the_lens_cannot_place_are_logged(bench) -> None:
    rig = Rig(bench, camera=FOLDING)
    bench.until(lambda: bench.logged('cannot be undone in'), 'the doubt about the lens')
    pixels = np.random.default_rng(0).uniform(0.0, 1.0, (60, 2)) * [1279.0, 1023.0]
    numbers = np.arange(60)
    rig.show(Features(numbers, pixels, pixels, numbers, np.zeros(60)))
    bench.until(lambda: bench.logged('features are left out'), 'the share that is left out')
    said = bench.logged('features are left out')[0]
    lost = int((~FOLDING.round_trips(pixels, FOLDING.rays(pixels))).sum())
    assert said.startswith(f'{lost} of 60 features are left out')
    assert 'plumb_bob lens' in said


CROP = Camera(1280, 1024, 769.2, 769.2, 200.0, 512.0)


@pytest.mark.parametrize('cropped', [False, True])
def test_a_principal_point_at_the_side_is_that_of_a_crop_alone(bench, cropped) -> None:
    show, clouds = bench.talk(Image, 'image_raw'), bench.listen(PointCloud2, 'tracks')
    bench.start(TrackerNode, cropped=cropped)
    Rig(bench, camera=CROP, cropped=cropped)
    show(write.image(np.zeros((1024, 1280), np.uint8), 'mono8', 1, 'camera'))
    bench.until(lambda: clouds, 'the tracks')
    for text in ('cannot be used, the robot stands', 'or say that the image is a crop (cropped)'):
        if not cropped:
            bench.until(lambda text=text: bench.logged(text), text)
        assert cropped is not bool(bench.logged(text))


FIRST, SECOND = 7, 4_000_000_000
OTHER_GOAL = 'the photograph has changed in mid-run'


def of(bench, goal=FIRST, **values) -> Rig:
    """Return a robot that drives to the photograph ``goal``."""
    rig = Rig(bench, **values)
    rig.goal = goal
    return rig.drive()


@pytest.mark.parametrize('blank', [0, 3], ids=['at once', 'looked for'])
def test_another_photograph_in_mid_run_stops_the_robot_for_good(bench, blank) -> None:
    rig = of(bench, holding_timeout=0.5 + 0.1 * blank)
    rig.goal = SECOND
    for _ in range(blank):
        rig.show()
    for _ in range(8):
        rig.see()
        assert rig.twist == STANDSTILL
        assert OTHER_GOAL in rig.reason
    assert rig.phase == 'failed'
    bench.until(lambda: bench.logged(f'{OTHER_GOAL}: its tracks lead to another goal'), 'the log')


@pytest.mark.parametrize(('reset', 'goal'), [(False, FIRST), (True, SECOND)])
def test_a_run_goes_on_with_its_own_photograph_and_a_new_one_with_another(
    bench, reset, goal
) -> None:
    rig = of(bench)
    rig.goal = SECOND
    rig.see()
    if reset:
        bench.call('servo_node/reset')
    rig.goal = goal
    rig.drive()


BEGIN = Pose(4.0, -2.0, 3.1)


def test_the_servo_hears_odometry_and_logs_that_none_comes(bench) -> None:
    tell = bench.talk(Odometry, 'odom')
    rig = Rig(bench, odometry=True)

    def driven(frame: str) -> Pose | None:
        """Publish odometry before and after the next image; return what the servo takes of it."""
        for stamp_ns in (rig.stamp_ns - PERIOD_NS // 2, rig.stamp_ns + PERIOD_NS // 2):
            tell(write.odometry(BEGIN, STANDSTILL, stamp_ns, frame, 'base_link'))
        bench.settle()
        rig.see()
        return odometry_of(rig.telemetry)

    rig.see()
    bench.until(lambda: bool(bench.logged('nothing usable came on /odom')), 'the complaint')
    assert bench.logged('nothing usable came on /odom')[0].endswith(MEANWHILE)
    assert odometry_of(rig.telemetry) is None
    pose = driven('odom')
    assert (pose.x, pose.y, pose.theta) == pytest.approx((BEGIN.x, BEGIN.y, BEGIN.theta))
    assert driven('map') is None  # two poses are not of one frame
    words = '/odom is in the frame map, was in odom before; look at what publishes it: /probe'
    bench.until(lambda: bool(bench.logged(words)), words)
    assert driven('map') is not None
