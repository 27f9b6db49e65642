"""The photograph that is captured: of images at rest, kept on disk with its camera."""

from dataclasses import replace
import os
import shutil

import cv2
from durations import few_of
import numpy as np
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image
from std_msgs.msg import String
import tracker_rig
from tracker_rig import message
import yaml

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.goal import goal_id
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.photograph import (
    keep,
    load,
    Photograph,
    read_photographs,
)
from visual_servo_epipolar.nodes.photographer import Photographer, Renewal
from visual_servo_epipolar.nodes.tracker_node import TrackerNode
from visual_servo_epipolar.simulation.light import LightSettings

HOME = Pose.from_start(0.0, 0.0, 0.0)


class Rig(tracker_rig.Rig):
    """A tracker with a camera that stands at the goal, or is driven about."""

    def __init__(self, bench, simulator, *, camera=None, **values) -> None:
        super().__init__(bench, simulator, **values)
        self.stamp_ns, self.camera = 0, camera or self.camera
        self.calibrated()

    def see(self, pose=HOME, times=1):
        """Send images, each with noise of its own, and return the last features."""
        for _ in range(times):
            self.stamp_ns += 1_000_000
            count = len(self.clouds)
            image = self.simulator.capture(pose, self.stamp_ns // 1_000_000)
            self.send(message(image, self.stamp_ns))
            self.bench.until(lambda count=count: len(self.clouds) > count, 'tracks')
        return read.features(self.clouds[-1])

    def capture(self):
        return self.bench.call('tracker_node/capture_desired')

    def desired(self):
        received = self.bench.listen(Image, 'tracker_node/desired/image_raw', qos.LATCHED)
        self.bench.until(lambda: bool(received), 'the photograph')
        return read.gray(received[-1])


def test_a_photograph_is_the_mean_of_the_last_images(bench, simulator) -> None:
    rig = Rig(bench, simulator, capture_frames=8)
    rig.see(times=12)
    answer = rig.capture()
    assert answer.success
    assert answer.message == 'this is the pose to come back to, the mean of 8 images'
    images = [simulator.capture(HOME, number) for number in range(5, 13)]
    expected = np.rint(np.mean(images, axis=0))
    assert np.abs(rig.desired() - expected).max() <= 1.0
    assert (rig.desired() == expected).mean() > 0.9


def test_images_from_before_the_robot_stood_are_left_out(bench, simulator) -> None:
    rig = Rig(bench, simulator, capture_frames=8)
    rig.see(Pose.from_start(0.0, -0.1, 0.0), times=3)
    rig.see(times=4)
    assert rig.capture().message.endswith(', the mean of 4 images')


def test_a_robot_that_moves_is_not_captured(bench, simulator) -> None:
    rig = Rig(bench, simulator)
    for step in range(4):
        rig.see(Pose.from_start(0.0, -0.02 * step, 0.0))
    answer = rig.capture()
    assert not answer.success
    assert answer.message.startswith('the last two images differ: the view moves by ')
    assert not rig.node.ready
    rig.see(Pose.from_start(0.0, -0.06, 0.0))
    assert rig.capture().success  # now it stands


def test_a_captured_photograph_is_there_after_a_restart(bench, simulator, tmp_path) -> None:
    path = tmp_path / 'goal.yaml'
    rig = Rig(bench, simulator, photograph=str(path))
    rig.see(times=3)
    answer = rig.capture()
    assert answer.message.endswith(f'the mean of 3 images, kept in {path}')
    before = rig.desired()
    assert sorted(item.suffix for item in tmp_path.iterdir()) == ['.png', '.yaml']
    kept = load(path)
    assert kept.camera == simulator.camera
    assert kept.stamp_ns == rig.stamp_ns
    bench.remove(rig.node)
    rig = Rig(bench, simulator, photograph=str(path))
    bench.until(lambda: bench.logged(f'desired image is {path}'), 'the file in the log')
    assert len(rig.see()) >= 40
    np.testing.assert_array_equal(rig.desired(), before)


@pytest.mark.parametrize('anew', ['captured', 'of elsewhere'])
def test_a_photograph_of_another_camera_leads_nowhere(bench, simulator, tmp_path, anew) -> None:
    path, camera = tmp_path / 'goal.yaml', simulator.camera
    keep(path, Photograph(simulator.capture(HOME, 3), replace(camera, fx=150.0, fy=150.0)))
    rig = Rig(bench, simulator, photograph=str(path))
    assert len(rig.see()) == 0
    text = 'the photograph was taken with another camera: fx 150 ->'
    bench.until(lambda: bench.logged(text), 'the complaint')
    if anew == 'captured':
        assert rig.capture().success
        assert load(path).camera == camera
    else:
        rig.teach(message(simulator.photograph()))
        bench.until(lambda: bench.logged('px taken'), 'the photograph')
    assert len(rig.see()) >= 40  # it is of this camera now


def test_a_camera_that_was_calibrated_anew_is_the_same(bench, simulator, tmp_path) -> None:
    path, camera = tmp_path / 'goal.yaml', simulator.camera
    anew = replace(camera, fx=1.005 * camera.fx, cx=camera.cx + 0.7)
    keep(path, Photograph(simulator.photograph(), anew))
    assert len(Rig(bench, simulator, photograph=str(path)).see()) >= 40


def test_a_photograph_that_cannot_be_kept_is_said_so(bench, simulator, tmp_path) -> None:
    folder = tmp_path / 'folder'
    folder.mkdir()
    rig = Rig(bench, simulator, photograph=str(folder / 'goal.yaml'))
    rig.see()
    shutil.rmtree(folder)
    answer = rig.capture()
    assert answer.success
    assert ', but it is not kept: ' in answer.message


def picture(path):
    (found,) = path.parent.glob('goal-*.png')
    return found


def cut_short(path) -> None:
    picture(path).write_bytes(picture(path).read_bytes()[:40])


def exchanged(path) -> None:
    blank = np.full((240, 320), 90, np.uint8)
    picture(path).write_bytes(cv2.imencode('.png', blank)[1].tobytes())


def of_another_size(path) -> None:
    picture(path).write_bytes(cv2.imencode('.png', np.zeros((9, 9), np.uint8))[1].tobytes())


def without(key):
    def change(path) -> None:
        document = yaml.safe_load(path.read_text())
        del document[key]
        path.write_text(yaml.safe_dump(document))

    return change


def changed(key, value):
    def change(path) -> None:
        path.write_text(yaml.safe_dump({**yaml.safe_load(path.read_text()), key: value}))

    return change


@pytest.mark.parametrize(
    ('damage', 'reason'),
    few_of(
        [
            (lambda path: picture(path).unlink(), 'is missing or broken'),
            (cut_short, 'is missing or broken'),
            (exchanged, 'is another one'),
            (of_another_size, 'its picture has 9x9 px, its camera 320x240'),
            (lambda path: path.write_text(''), "lacks 'camera_matrix'"),
            (lambda path: path.write_bytes(b'\xff\xfe\x00'), 'cannot be used'),
            (lambda path: path.write_text('a: [1'), 'cannot be used'),
            (without('camera_matrix'), "lacks 'camera_matrix'"),
            (without('photograph'), 'photograph must be a name, got None'),
            (without('stamp_ns'), 'stamp_ns must be a whole number'),
            (without('goal'), 'is another one'),
            (changed('photograph', [1]), 'photograph must be a name, got [1]'),
            *(
                (changed('stamp_ns', value), 'stamp_ns must be a whole number from 0 to ')
                for value in ('now', True, [], {}, -1, 10**30, float('inf'), float('nan'))
            ),
            (
                changed('camera_matrix', None),
                'camera_matrix must be a list of 9 numbers, finite and below 1e+09, got None',
            ),
            (changed('image_width', None), 'image_width must be a whole number'),
        ],
        keep=(0, 1, 2, 3, 7, 9, 12, 20),
    ),
)
def test_a_broken_one_is_one_line(simulator, tmp_path, damage, reason) -> None:
    path = tmp_path / 'goal.yaml'
    keep(path, Photograph(simulator.photograph(), simulator.camera))
    damage(path)
    with pytest.raises(ValueError, match='cannot be used') as caught:
        load(path)
    assert reason in str(caught.value)
    assert '\n' not in str(caught.value)
    assert str(caught.value).endswith('; move it away, and capture anew')


@pytest.mark.parametrize(
    ('values', 'reason'),
    [
        ({'photograph': '{}/goal.png'}, 'the name of a .yaml file'),
        ({'photograph': '{}/none/goal.yaml'}, 'a folder that can be written'),
        ({'photograph': '{}/a.yaml', 'desired_image': 'b.png'}, 'exclude each other'),
        *(
            ({'desired_image': f'{{}}/{name}'}, 'desired_image must be a readable image file')
            for name in ('missing.png', 'empty.png', 'text.png')
        ),
    ],
)
def test_files_that_cannot_be_used_are_refused_at_the_start(
    bench, tmp_path, values, reason
) -> None:
    (tmp_path / 'empty.png').touch()
    (tmp_path / 'text.png').write_text('not an image')
    with pytest.raises(ValueError, match=reason):
        bench.start(TrackerNode, **{key: it.format(tmp_path) for key, it in values.items()})


def test_a_crash_leaves_the_former_photograph(simulator, tmp_path, monkeypatch) -> None:
    path, image = tmp_path / 'goal.yaml', simulator.photograph()
    keep(path, Photograph(image, simulator.camera))
    for crash_at in (1, 2):  # while the picture is written, or the file that names it
        calls = []

        def fsync(_: int, calls=calls, crash_at=crash_at) -> None:
            calls.append(1)
            if len(calls) == crash_at:
                raise OSError('the power is gone')

        monkeypatch.setattr(os, 'fsync', fsync)
        with pytest.raises(OSError, match='power'):
            keep(path, Photograph(255 - image, simulator.camera))
        np.testing.assert_array_equal(load(path).image, image)
    monkeypatch.undo()
    keep(path, Photograph(255 - image, simulator.camera))
    np.testing.assert_array_equal(load(path).image, 255 - image)
    assert len(list(tmp_path.iterdir())) == 2


def test_photographs_in_other_light_are_added_and_kept(bench, simulator, tmp_path) -> None:
    path = tmp_path / 'goal.yaml'
    rig = Rig(bench, simulator, photograph=str(path), max_photographs=2)
    rig.see(times=2)
    assert rig.capture().success
    rig.see()
    goal = read.goal(rig.clouds[-1])
    rig.node.set_parameters([Parameter('capture_adds', value=True)])
    rig.see(Pose.from_start(0.3, -0.3, 0.0), times=2)
    refused = rig.capture()
    assert not refused.success
    assert 'cannot be added: the photograph was taken from another pose' in refused.message
    rig.see(times=11)
    added = rig.capture()
    assert 'this is photograph 2 of the pose to come back to' in added.message
    rig.see()
    assert read.goal(rig.clouds[-1]) == goal
    bench.until(lambda: bool(bench.logged('of 2 fits the light best')), 'the log')
    assert 'one photograph more than the 2 of one pose that are used' in rig.capture().message
    assert [len(images) for images in (load(path).more, list(tmp_path.glob('*.png')))] == [1, 2]
    bench.remove(rig.node)
    rig = Rig(bench, simulator, photograph=str(path))
    bench.until(lambda: bench.logged(f'desired image is {path}, 2 photographs'), 'both')
    rig.see()
    assert read.goal(rig.clouds[-1]) == goal
    assert load(path).images == 2
    next(tmp_path.glob(f'*{goal_id(load(path).more[0]):08x}.png')).unlink()
    with pytest.raises(ValueError, match='cannot be used: .*; move it away, and capture anew'):
        load(path)


def test_a_folder_gives_several_photographs(simulator, tmp_path) -> None:
    names = [str(tmp_path / f'{name}.png') for name in ('noon', 'dusk')]
    for number, name in enumerate(names):
        cv2.imwrite(name, simulator.capture(HOME, number))
    (tmp_path / 'notes.txt').touch()
    assert list(read_photographs(names[0], 4)) == names[:1]
    (tmp_path / '._noon.png').write_bytes(b'what macOS keeps beside a file')
    (tmp_path / 'old.png').mkdir()
    assert list(read_photographs(str(tmp_path), 4)) == sorted(names)
    (tmp_path / 'none').mkdir()
    with pytest.raises(ValueError, match='must be a folder with pictures, got .*none'):
        read_photographs(str(tmp_path / 'none'), 4)
    with pytest.raises(ValueError, match=r'must be a readable image file, got .*rain.png'):
        read_photographs('rain.png', 4)
    (tmp_path / 'aaa.png').write_bytes(b'not even read')
    with pytest.raises(ValueError, match=r'at most \d photographs, got \d by'):
        read_photographs(str(tmp_path), len(names))


def test_an_arrival_in_another_light_renews_the_photographs(bench, simulator, tmp_path) -> None:
    path, frames = tmp_path / 'goal.yaml', {'capture_frames': 3, 'renew': True}
    rig = Rig(bench, simulator, photograph=str(path), **frames)
    say = bench.talk(String, 'phase', qos.LATCHED)
    rig.see(times=4)
    assert rig.capture().success
    rig.see()
    goal = read.goal(rig.clouds[-1])
    for light, kept in (('ceiling', 0), ('lamp_side', 1), ('lamp_side', 1)):
        simulator.relight(LightSettings(light=light, exposure='auto'))
        rig.see(times=4)
        for phase in ('approaching', 'arrived'):
            say(String(data=phase))
            bench.settle()
        rig.see(times=4)
        assert len(load(path).more) == kept
    simulator.relight(LightSettings())
    assert read.goal(rig.clouds[-1]) == goal
    assert bench.logged('the view in the light of today is one of 2 photographs now, kept in')


IMAGE = np.zeros((6, 8), np.uint8)
NO_IMAGE = 'no usable image is there; check image_raw and camera_info'


@pytest.mark.parametrize(('age', 'old'), [(0.95, False), (1.05, True)])
def test_an_image_of_a_camera_that_fell_silent_is_no_photograph(clock, age, old) -> None:
    photographer = Photographer(3, '')
    photographer.see(IMAGE)
    clock.go_on(age)
    if not old:
        assert photographer.capture()[1] == 1
        return
    with pytest.raises(ValueError, match=r'the last image is 1.1 s old; check the camera'):
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


def test_no_photograph_is_captured_while_the_camera_is_uncalibrated(bench, simulator) -> None:
    rig = Rig(bench, simulator)
    rig.see()
    uncalibrated = write.camera_info(rig.camera, 0, 'camera')
    uncalibrated.k[0] = 0.0
    rig.calibrate(uncalibrated)
    bench.settle()
    answer = rig.capture()
    assert (answer.success, answer.message) == (False, NO_IMAGE)
