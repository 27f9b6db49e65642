"""The tracker as a node: one cloud for each image, empty when nothing is to be trusted."""

import re

import cv2
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycles import change, entities, go
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


PERIOD_NS = 90_909_091


class Led(Rig):
    """A tracker that is led about, with a camera in front of it."""

    def __init__(self, bench, simulator, view, **values) -> None:
        self.view, self.stamp_ns = view, STAMP_NS
        self.desired = bench.listen(Image, 'tracker_node/desired/image_raw', qos.LATCHED)
        super().__init__(bench, simulator, **values)

    def see(self, *, calibrated=True) -> int:
        """Let an image arrive, and return how many features came of it; -1 if no cloud did."""
        count = len(self.clouds)
        if calibrated:
            self.calibrate(write.camera_info(self.camera, self.stamp_ns, 'camera'))
            self.bench.settle()
        self.send(write.image(self.view, 'mono8', self.stamp_ns, 'camera'))
        self.stamp_ns += PERIOD_NS
        self.bench.settle()
        return len(read.features(self.clouds[-1])) if len(self.clouds) > count else -1


@pytest.fixture
def led(bench, simulator, view):
    return Led(bench, simulator, view)


def test_its_last_word_is_an_empty_cloud_which_stops_the_servo(led, photograph) -> None:
    assert led.taught(photograph).see() > 40
    go(led.bench, led.node, 'deactivate')
    led.bench.until(lambda: not len(read.features(led.clouds[-1])), 'an empty cloud')
    first, last = (read.stamp_ns(cloud.header) for cloud in led.clouds[-2:])
    assert last > first
    assert led.clouds[-1].header.frame_id == 'camera'
    assert led.see() == -1


def test_it_keeps_photograph_and_camera_while_inactive_and_then_matches_anew(
    led, photograph
) -> None:
    led.taught(photograph).see()
    assert led.see() > 40
    assert read.features(led.clouds[-1]).ages.max() == 1
    go(led.bench, led.node, 'deactivate', 'activate')
    assert led.see(calibrated=False) > 40
    assert read.features(led.clouds[-1]).ages.max() == 0


def test_an_image_of_before_is_not_tracked(led, photograph) -> None:
    assert led.taught(photograph).see(calibrated=False) == -1  # it waits for camera_info
    go(led.bench, led.node, 'deactivate', 'activate')
    led.calibrate(write.camera_info(led.camera, led.stamp_ns, 'camera'))
    led.bench.settle()
    assert led.clouds == []


def test_an_image_of_before_is_no_goal(led, photograph) -> None:
    led.taught(photograph).see()
    go(led.bench, led.node, 'deactivate', 'activate')
    answer = led.bench.call('tracker_node/capture_desired')
    assert (answer.success, 'no usable image is there' in answer.message) == (False, True)


def test_a_photograph_that_comes_while_it_is_inactive_is_taken(led, photograph, view) -> None:
    led.taught(view)
    go(led.bench, led.node, 'deactivate')
    led.teach(write.image(photograph, 'mono8', 0, 'camera'))
    led.bench.settle()
    told = len(led.desired)
    go(led.bench, led.node, 'activate')
    led.bench.until(lambda: len(led.desired) > told, 'the photograph to be shown')
    assert (read.gray(led.desired[-1]) == photograph).all()


def test_after_a_cleanup_it_asks_anew_for_camera_and_photograph(led, photograph) -> None:
    led.taught(photograph).see()
    go(led.bench, led.node, 'deactivate', 'cleanup', 'configure', 'activate')
    led.bench.until(lambda: led.node.ready, 'the photograph, which is latched')
    assert led.see(calibrated=False) == -1
    led.bench.until(lambda: led.bench.logged('no usable camera_info yet'), 'what it waits for')
    assert led.see() > 40


@pytest.mark.parametrize('kept', [True, False])
def test_a_photograph_outlives_a_cleanup_if_kept(bench, simulator, view, tmp_path, kept) -> None:
    path = str(tmp_path / 'goal.yaml') if kept else ''
    led = Led(bench, simulator, view, photograph=path)
    led.see()
    assert bench.call('tracker_node/capture_desired').success
    go(bench, led.node, 'deactivate', 'cleanup', 'configure', 'activate')
    assert led.node.ready == kept
    assert (led.see() > 40) == kept


def test_a_broken_photograph_leaves_it_unconfigured(bench, simulator, view, tmp_path) -> None:
    path = tmp_path / 'goal.yaml'
    led = Led(bench, simulator, view, photograph=str(path), autostart_node=False)
    before = entities(led.node)
    path.write_text('no photograph')
    assert not change(bench, led.node, label='configure')
    assert (led.node.state, entities(led.node)) == ('unconfigured', before)
    bench.until(lambda: bench.logged('configure failed: photograph'), 'the reason')
    path.unlink()
    assert go(bench, led.node, 'configure', 'activate') == 'active'
