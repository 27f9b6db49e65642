"""The tracker as a node: one cloud for each image, empty when nothing is to be trusted."""

import re

import cv2
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
import numpy as np
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from tracker_rig import message, Rig, STAMP_NS

from visual_servo_epipolar.core.cameras.registry import camera_of_size
from visual_servo_epipolar.core.tracking.tracker import Tracker, TrackerSettings
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import qos, tracker_reports
from visual_servo_epipolar.nodes.tracker_node import PATIENCE_S, TrackerNode


@pytest.fixture(autouse=True)
def patient(monkeypatch) -> None:
    monkeypatch.setattr(tracker_reports, 'SILENT_S', 600.0)  # however long a test takes


@pytest.fixture
def attentive(monkeypatch) -> None:
    monkeypatch.setattr(tracker_reports, 'IDLE_PERIOD_S', 0.02)
    monkeypatch.setattr(tracker_reports, 'SILENT_S', 0.2)
    monkeypatch.setattr(tracker_reports, 'PATIENCE_S', 0.2)


def now_ns(rig):
    return int(rig.node.get_clock().now().nanoseconds)


@pytest.fixture
def rig(bench, simulator):
    return Rig(bench, simulator)


def test_each_image_gives_the_tracks_of_the_core_with_its_stamp(rig, photograph, view) -> None:
    tracker = Tracker(TrackerSettings())
    tracker.set_desired(photograph)
    rig.calibrated().taught(photograph)
    for number in range(3):
        features, expected = rig.track(view, STAMP_NS + number), tracker.track(view)
        assert len(expected) >= 40
        np.testing.assert_array_equal(features.ids, expected.ids)
        np.testing.assert_array_equal(features.current, expected.current)
        np.testing.assert_array_equal(features.desired, expected.desired)
    rig.bench.settle()
    stamps = [read.stamp_ns(cloud.header) for cloud in rig.clouds]
    assert stamps == [STAMP_NS, STAMP_NS + 1, STAMP_NS + 2]
    assert rig.clouds[0].header.frame_id == 'camera'


def test_a_setting_changed_on_the_way_counts_from_the_next_photograph(
    rig, photograph, view
) -> None:
    tracker = Tracker(TrackerSettings(max_features=50))
    tracker.set_desired(photograph)
    rig.node.set_parameters([Parameter('max_features', value=50)])
    features = rig.calibrated().taught(photograph).track(view)
    np.testing.assert_array_equal(features.ids, tracker.track(view).ids)


def test_an_image_of_another_time_is_published_as_one(rig, photograph, view) -> None:
    rig.calibrated().taught(photograph)
    for number, image in enumerate((view, photograph, view)):
        rig.track(image, STAMP_NS + number)
    assert [read.back(cloud) for cloud in rig.clouds] == [0, 0, 2]


def test_without_a_photograph_nothing_is_tracked(rig, view) -> None:
    assert len(rig.calibrated().track(view)) == 0
    rig.bench.until(lambda: rig.bench.logged('no desired image yet'), 'the reason in the log')


def another_size(rig, view) -> None:
    rig.send(message(np.zeros((120, 160), np.uint8)))


def truncated(rig, view) -> None:
    broken = message(view)
    broken.data.pop()
    rig.send(broken)


def uncalibrated(rig, view) -> None:
    info = write.camera_info(rig.camera, 0, 'camera')
    info.k[0] = 0.0
    rig.calibrate(info)
    rig.bench.settle()
    rig.send(message(view))


@pytest.mark.parametrize(
    ('send', 'warning'),
    [
        (another_size, 'image has 160x120 px, its camera_info says 320x240'),
        (truncated, 'image refused: '),
        (uncalibrated, 'K[0] = 0 means an uncalibrated camera'),
    ],
)
def test_nothing_is_trusted_of_what_cannot_be_and_that_is_logged_once(
    rig, photograph, view, send, warning
) -> None:
    rig.calibrated().taught(photograph)
    for count in range(1, 4):  # within the five seconds of a complaint
        send(rig, view)
        rig.bench.until(lambda count=count: len(rig.clouds) == count, 'tracks')
        assert len(read.features(rig.clouds[-1])) == 0
    rig.bench.until(lambda: rig.bench.logged(warning), 'the warning')
    rig.bench.settle()
    assert len(rig.bench.logged(warning)) == 1
    assert len(rig.calibrated().track(view)) > 0


def test_an_image_waits_for_the_first_camera_info(rig, photograph, view) -> None:
    rig.taught(photograph)
    rig.send(message(view))
    rig.bench.settle()
    assert rig.clouds == []
    rig.calibrated()
    rig.bench.until(lambda: bool(rig.clouds), 'tracks')
    assert read.stamp_ns(rig.clouds[0].header) == STAMP_NS
    assert len(read.features(rig.clouds[0])) > 0


def test_the_view_of_now_can_be_captured_as_the_goal(rig, view) -> None:
    rig.calibrated().track(view)
    answer = rig.bench.call('tracker_node/capture_desired')
    assert answer.success, answer.message
    goal = read.goal(rig.clouds[-1])
    features = rig.track(view)
    assert read.goal(rig.clouds[-1]) not in (None, goal)
    assert len(features) >= 40
    # The same image twice: what is left is the interpolation of the alignment.
    np.testing.assert_allclose(features.current, features.desired, atol=0.01)


def test_orders_are_logged_and_so_are_their_refusals(rig, view) -> None:
    for order, text in (('capture_desired', 'captured'), ('redetect', 'redetected')):
        answer = rig.bench.call(f'tracker_node/{order}')
        said = f'not {text}: {answer.message}'
        assert not answer.success
        rig.bench.until(lambda said=said: rig.bench.logged(said), 'the refusal')
    rig.calibrated().track(view)
    assert rig.bench.call('tracker_node/capture_desired').success
    rig.bench.until(lambda: rig.bench.logged('captured: this is the pose'), 'the capture')


def test_a_blank_view_is_no_photograph_and_the_old_one_is_kept(rig, photograph, view) -> None:
    blank = np.full((240, 320), 90, np.uint8)
    rig.calibrated().taught(photograph).track(blank)
    answer = rig.bench.call('tracker_node/capture_desired')
    assert (answer.success, 'shows 0 features, at least 8' in answer.message) == (False, True)
    rig.teach(message(blank))
    rig.bench.until(lambda: rig.bench.logged('desired image refused'), 'the refusal')
    assert rig.bench.call('tracker_node/redetect').success
    assert len(rig.track(view)) > 0


def test_redetect_matches_the_next_image_anew(rig, photograph, view) -> None:
    rig.calibrated().taught(photograph).track(view)
    assert rig.track(view).ages.max() == 1
    assert rig.bench.call('tracker_node/redetect').success
    assert rig.track(view).ages.max() == 0


def test_a_file_may_be_given(bench, simulator, photograph, view, tmp_path, monkeypatch) -> None:
    path = tmp_path / 'goal ä.png'
    path.write_bytes(cv2.imencode('.png', photograph)[1].tobytes())
    monkeypatch.setenv('HOME', str(tmp_path))
    rig = Rig(bench, simulator, desired_image='~/goal ä.png')
    assert len(rig.calibrated().track(view)) >= 40
    bench.until(lambda: bench.logged(f'desired image is {path}'), 'the file in the log')


def test_the_photograph_in_use_is_published_for_late_listeners(rig, photograph) -> None:
    rig.calibrated().taught(photograph)
    received = rig.bench.listen(Image, 'tracker_node/desired/image_raw', qos.LATCHED)
    rig.bench.until(lambda: bool(received), 'the photograph')
    np.testing.assert_array_equal(read.gray(received[0]), photograph)


def test_the_overlay_is_drawn_for_its_subscribers(rig, photograph, view) -> None:
    rig.calibrated().taught(photograph).track(view)
    overlays = rig.bench.listen(Image, 'overlay/image_raw')
    (publisher,) = (it for it in rig.node.publishers if it.topic_name.startswith('/overlay'))
    rig.bench.until(lambda: publisher.get_subscription_count() == 1, 'the overlay to be heard')
    rig.track(view, STAMP_NS + 1)
    rig.bench.until(lambda: bool(overlays), 'the overlay')
    assert (overlays[0].encoding, overlays[0].width, overlays[0].height) == ('bgr8', 320, 240)
    assert read.stamp_ns(overlays[0].header) == STAMP_NS + 1


def test_why_the_photograph_is_not_found_stands_in_the_diagnostics(rig, photograph, view) -> None:
    reports = rig.bench.listen(DiagnosticArray, '/diagnostics')
    rig.calibrated().taught(photograph).track(np.full((240, 320), 90, np.uint8))
    rig.bench.until(lambda: bool(reports), 'the reason')
    status = reports[0].status[0]
    assert (status.level, status.name) == (b'\x01', '/tracker_node')
    assert status.message.startswith('the photograph is not seen from here: ')
    assert read.stamp_ns(reports[0].header) == STAMP_NS
    for number in range(1, 13):  # the whole image is matched now and then
        rig.track(view, STAMP_NS + number)
    rig.bench.until(lambda: reports[-1].status[0].level == b'\x00', 'the end of it')
    heard = len(reports)
    rig.track(view, STAMP_NS + 13)
    rig.bench.settle()
    assert len(reports) == heard  # nothing is said as long as all is well


def age_reported(heard: list[DiagnosticArray], words: str) -> float:
    """Return the age [s] in the last diagnostics after these ``words``, 0 without."""
    status = heard[-1].status[0] if heard else None
    if status is None or status.level != DiagnosticStatus.WARN:
        return 0.0
    age = re.fullmatch(rf'{words}, for (\d+\.\d) s; nothing is tracked', status.message)
    return float(age[1]) if age else 0.0


@pytest.mark.parametrize('simulated', [False, True])
def test_a_silent_camera_is_reported(
    bench, simulator, photograph, view, attentive, simulated
) -> None:
    heard = bench.listen(DiagnosticArray, '/diagnostics')
    rig = Rig(bench, simulator, use_sim_time=simulated)
    bench.until(lambda: age_reported(heard, 'no image has come yet') >= 0.3, 'that none came')
    bench.until(lambda: bench.logged('(publishers on /image_raw: 1)'), 'the log')
    rig.calibrated().taught(photograph).track(view)
    bench.until(lambda: heard[-1].status[0].message == 'the photograph is found', 'the images')
    first = read.stamp_ns(heard[-1].header)
    bench.until(lambda: age_reported(heard, 'the camera is silent') >= 0.5, 'the silence')
    values = {item.key: item.value for item in heard[-1].status[0].values}
    assert float(values['image_age_s']) >= 0.4
    assert simulated or read.stamp_ns(heard[-1].header) > first
    rig.track(view, STAMP_NS + 1)
    bench.until(lambda: heard[-1].status[0].level == DiagnosticStatus.OK, 'the end of it')


def test_images_that_wait_for_their_camera_are_reported(bench, simulator, view, attentive) -> None:
    heard = bench.listen(DiagnosticArray, '/diagnostics')
    rig = Rig(bench, simulator)
    rig.send(message(view))
    words = 'images wait for a usable camera_info'
    bench.until(lambda: age_reported(heard, words) >= 0.3, 'what they wait for')


def test_of_images_that_came_meanwhile_only_the_newest_is_tracked(rig, photograph, view) -> None:
    rig.calibrated().taught(photograph).track(view)
    rig.clouds.clear()
    for number in range(1, 7):  # nothing spins: the tracker is busy
        rig.send(message(view, STAMP_NS + number))
    rig.bench.until(lambda: bool(rig.clouds), 'tracks')
    rig.bench.settle()
    assert [read.stamp_ns(cloud.header) for cloud in rig.clouds] == [STAMP_NS + 6]


def test_the_same_photograph_again_changes_nothing(rig, photograph, view) -> None:
    rig.calibrated().taught(photograph).track(view)
    goal = read.goal(rig.clouds[-1])
    rig.teach(message(photograph))
    rig.bench.settle()
    assert rig.track(view, STAMP_NS + 1).ages.max() == 1
    assert read.goal(rig.clouds[-1]) == goal


def test_a_panorama_needs_no_camera_info_and_the_tracker_publishes_it(
    bench, simulator, photograph, view
) -> None:
    infos = bench.listen(CameraInfo, 'camera_info')
    # A driver advertises camera_info, and sends none.
    rig = Rig(bench, simulator, projection='equirectangular')
    send, clouds = rig.send, rig.clouds
    wide, goal = (np.ascontiguousarray(each[40:200]) for each in (view, photograph))
    panorama = camera_of_size('equirectangular', wide.shape[::-1])
    rig.taught(goal)
    send(message(wide, 1))
    bench.until(lambda: clouds, 'tracks')
    send(message(wide, round((PATIENCE_S + 1.0) * 1e9)))
    bench.until(lambda: len(clouds) > 1 and infos, 'tracks and camera_info')
    assert len(infos) == 1
    assert read.camera(infos[-1]) == panorama
    tracker = Tracker(TrackerSettings(), panorama)
    tracker.set_desired(goal)
    expected, features = tracker.track(wide), read.features(clouds[0])
    assert len(features) > 8
    np.testing.assert_array_equal(features.ids, expected.ids)
    np.testing.assert_allclose(features.current, expected.current, atol=1e-4)
    rig.calibrated()  # of another lens
    for stamp_ns in (8_000_000_000, 9_000_000_000):
        assert len(rig.track(wide, stamp_ns)) == 0


def test_no_panorama_or_another_lens_stop_the_robot(bench, simulator, photograph, view) -> None:
    rig = Rig(bench, simulator, projection='equirectangular')
    rig.taught(photograph)
    assert len(rig.track(view)) == 0  # it is too high
    rig.calibrated()
    assert len(rig.track(view)) == 0
    text = 'is of a pinhole lens; remap camera_info'
    bench.until(lambda: bench.logged(text), text)


def test_what_is_assumed_of_a_cut_panorama_is_logged_once(bench) -> None:
    clouds, send = bench.listen(PointCloud2, 'tracks'), bench.talk(Image, 'image_raw')
    bench.start(TrackerNode, projection='equirectangular')
    for number in range(3):
        send(message(np.zeros((60, 200), np.uint8)))
        bench.until(lambda number=number: len(clouds) > number, 'tracks')
    bench.until(lambda: bool(bench.logged('with as many rows cut above as below')), 'the note')
    assert len(bench.logged('with as many rows cut above as below')) == 1
