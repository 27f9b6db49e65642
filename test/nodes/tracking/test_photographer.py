"""A photograph is of where the robot stands now, by the camera that is there."""

from dataclasses import replace

import numpy as np
import pytest
from sensor_msgs.msg import CameraInfo, Image
from servo_rig import HandSetClock

from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.tracker_node import TrackerNode
from visual_servo_epipolar.nodes.tracking.photograph import keep, Photograph
from visual_servo_epipolar.nodes.tracking.photographer import Photographer, Renewal

IMAGE = np.zeros((6, 8), np.uint8)
NO_IMAGE = 'no usable image is there; check image_raw and camera_info'


@pytest.mark.parametrize(('age', 'old'), [(0.95, False), (1.05, True)])
def test_an_image_of_a_camera_that_fell_silent_is_no_photograph(age, old) -> None:
    photographer = Photographer(3, '')
    clock = photographer._steady = HandSetClock()
    photographer.see(IMAGE)
    clock.now_ns += round(age * 1e9)
    if not old:
        assert photographer.capture()[1] == 1
        return
    with pytest.raises(ValueError, match=r'the last image is 1.1 s old; check the camera'):
        photographer.capture()


def test_images_from_before_one_that_cannot_be_used_are_left_out() -> None:
    photographer = Photographer(3, '')
    photographer.see(IMAGE)
    photographer.see(None)
    with pytest.raises(ValueError, match=NO_IMAGE):
        photographer.capture()


def test_one_view_follows_an_arrival_that_was_seen() -> None:
    renewal = Renewal(2)
    told = ['arrived', 'arrived', 'approaching', 'arrived', 'arrived', 'arrived', 'arrived']
    due = []
    for phase in told:  # the servo says it with each image
        renewal.follow(phase)
        due.append(renewal.is_due())
    assert due == [False, False, False, False, True, False, False]
    for phase in ('approaching', 'arrived', 'waiting'):
        renewal.follow(phase)
        assert not renewal.is_due()


class Rig:
    """A tracker that has seen an image, and can be asked for a photograph."""

    def __init__(self, bench, simulator, view, **values) -> None:
        self.bench, self.camera = bench, simulator.camera
        self._send, self._view = bench.talk(Image, 'image_raw'), view
        self.calibrate = bench.talk(CameraInfo, 'camera_info')
        self.node = bench.start(TrackerNode, **values)
        self.calibrate(write.camera_info(self.camera, 0, 'camera'))
        bench.until(lambda: self.node._camera is not None, 'camera_info')
        self.see()

    def see(self) -> None:
        self._send(write.image(self._view, 'mono8', 7, 'camera'))
        self.bench.until(lambda: self.node._latest is not None, 'the image')

    def capture(self) -> str:
        answer = self.bench.call('tracker_node/capture_desired')
        return '' if answer.success else answer.message


@pytest.fixture
def rig(bench, simulator, view):
    return Rig(bench, simulator, view)


def test_no_photograph_is_captured_while_the_camera_is_uncalibrated(rig) -> None:
    uncalibrated = write.camera_info(rig.camera, 0, 'camera')
    uncalibrated.k[0] = 0.0
    rig.calibrate(uncalibrated)
    rig.bench.until(lambda: rig.node._camera is None, 'camera_info to arrive')
    assert rig.capture() == NO_IMAGE


def test_a_photograph_from_elsewhere_is_of_no_other_camera(
    bench, simulator, view, photograph, tmp_path
) -> None:
    path, other = tmp_path / 'goal.yaml', replace(simulator.camera, fx=150.0, fy=150.0)
    keep(path, Photograph(view, other))
    rig = Rig(bench, simulator, view, photograph=str(path))
    assert rig.node._photographer.complaint(rig.camera)
    bench.talk(Image, 'desired/image_raw', qos.LATCHED)(write.image(photograph, 'mono8', 7, 'c'))
    bench.until(lambda: bench.logged('px taken'), 'the photograph')
    assert rig.node._photographer.complaint(rig.camera) == ''
