"""The life cycle of the tracker: what it keeps while inactive, and what it asks for anew."""

from lifecycles import change, entities, go
import pytest
from sensor_msgs.msg import Image
from tracker_rig import Rig, STAMP_NS

from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import qos

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
def rig(bench, simulator, view):
    return Led(bench, simulator, view)


def test_a_tracker_that_is_not_active_is_silent(bench, simulator, view) -> None:
    rig = Led(bench, simulator, view, autostart_node=False)
    assert rig.see() == -1
    go(bench, rig.node, 'configure')
    assert rig.see() == -1
    answer = bench.call('tracker_node/capture_desired')
    assert (answer.success, 'is inactive; call ros2' in answer.message) == (False, True)
    go(bench, rig.node, 'activate')
    assert rig.see() == 0  # no photograph


def test_its_last_word_is_an_empty_cloud_which_stops_the_servo(rig, photograph) -> None:
    assert rig.taught(photograph).see() > 40
    go(rig.bench, rig.node, 'deactivate')
    rig.bench.until(lambda: not len(read.features(rig.clouds[-1])), 'an empty cloud')
    first, last = (read.stamp_ns(cloud.header) for cloud in rig.clouds[-2:])
    assert last > first
    assert rig.clouds[-1].header.frame_id == 'camera'
    assert rig.see() == -1


def test_it_keeps_photograph_and_camera_while_inactive_and_then_matches_anew(
    rig, photograph
) -> None:
    rig.taught(photograph).see()
    assert rig.see() > 40
    assert read.features(rig.clouds[-1]).ages.max() == 1
    go(rig.bench, rig.node, 'deactivate', 'activate')
    assert rig.see(calibrated=False) > 40
    assert read.features(rig.clouds[-1]).ages.max() == 0


def test_an_image_of_before_is_not_tracked(rig, photograph) -> None:
    assert rig.taught(photograph).see(calibrated=False) == -1  # it waits for camera_info
    go(rig.bench, rig.node, 'deactivate', 'activate')
    rig.calibrate(write.camera_info(rig.camera, rig.stamp_ns, 'camera'))
    rig.bench.settle()
    assert rig.clouds == []


def test_an_image_of_before_is_no_goal(rig, photograph) -> None:
    rig.taught(photograph).see()
    go(rig.bench, rig.node, 'deactivate', 'activate')
    answer = rig.bench.call('tracker_node/capture_desired')
    assert (answer.success, 'no usable image is there' in answer.message) == (False, True)


def test_a_photograph_that_comes_while_it_is_inactive_is_taken(rig, photograph, view) -> None:
    rig.taught(view)
    go(rig.bench, rig.node, 'deactivate')
    rig.teach(write.image(photograph, 'mono8', 0, 'camera'))
    rig.bench.settle()
    told = len(rig.desired)
    go(rig.bench, rig.node, 'activate')
    rig.bench.until(lambda: len(rig.desired) > told, 'the photograph to be shown')
    assert (read.gray(rig.desired[-1]) == photograph).all()


def test_after_a_cleanup_it_asks_anew_for_camera_and_photograph(rig, photograph) -> None:
    rig.taught(photograph).see()
    go(rig.bench, rig.node, 'deactivate', 'cleanup', 'configure', 'activate')
    rig.bench.until(lambda: rig.node.ready, 'the photograph, which is latched')
    assert rig.see(calibrated=False) == -1
    rig.bench.until(lambda: rig.bench.logged('no usable camera_info yet'), 'what it waits for')
    assert rig.see() > 40


@pytest.mark.parametrize('kept', [True, False])
def test_a_photograph_outlives_a_cleanup_if_kept(bench, simulator, view, tmp_path, kept) -> None:
    path = str(tmp_path / 'goal.yaml') if kept else ''
    rig = Led(bench, simulator, view, photograph=path)
    rig.see()
    assert bench.call('tracker_node/capture_desired').success
    go(bench, rig.node, 'deactivate', 'cleanup', 'configure', 'activate')
    assert rig.node.ready == kept
    assert (rig.see() > 40) == kept


def test_a_broken_photograph_leaves_it_unconfigured(bench, simulator, view, tmp_path) -> None:
    path = tmp_path / 'goal.yaml'
    rig = Led(bench, simulator, view, photograph=str(path), autostart_node=False)
    before = entities(rig.node)
    path.write_text('no photograph')
    assert not change(bench, rig.node, label='configure')
    assert (rig.node.state, entities(rig.node)) == ('unconfigured', before)
    bench.until(lambda: bench.logged('configure failed: photograph'), 'the reason')
    path.unlink()
    assert go(bench, rig.node, 'configure', 'activate') == 'active'
