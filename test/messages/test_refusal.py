"""A message that cannot be used is one clear ValueError."""

from dataclasses import replace
import math

import cv2
from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import pytest

from visual_servo_epipolar.core.cameras.equirectangular import of_size
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL
from visual_servo_epipolar.core.tracking import photographs
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.messages.tracking import track
from visual_servo_epipolar.messages.validation import checked_features, checked_tracks

NAN = math.nan
INFINITE = (NAN, math.inf, -math.inf)


def image():
    return write.image(np.zeros((4, 6), np.uint8), 'mono8', 0, 'camera')


def info():
    return write.camera_info(Camera(640, 480, 400.0, 400.0, 320.0, 240.0), 0, 'camera')


def tracks():
    two = np.ones((2, 2))
    value = Features(ids=[1, 2], current=two, desired=two, ages=[1, 1], errors=[0, 0])
    return write.features(value, 0, 'camera')


def nowhere():
    message = tracks()
    np.frombuffer(message.data, write.TRACK_LAYOUT)['u'][0] = NAN
    return message


def twist():
    return write.twist(STANDSTILL)


def stamped():
    return write.twist_stamped(STANDSTILL, 0, 'base')


def odometry():
    return write.odometry(Pose(1, 2, 0), STANDSTILL, 0, 'world', 'base')


def numbers():
    return write.telemetry({'a': 1.0}, 0, '')


def put(message, path: str, value) -> None:
    """Give a part of a message another value."""
    *way, last = path.split('.')
    for name in way:
        message = message[int(name)] if name.isdigit() else getattr(message, name)
    if last.isdigit():
        message[int(last)] = value
    else:
        setattr(message, last, value)


ROWS = r'the rows of K must be \(fx, s, cx\)'
QUATERNION = 'must be a quaternion of length 1, got length'
REFUSED = [
    (read.gray, image, 'encoding', 'bgr8', 'at least 18 each'),
    *(
        (read.gray, image, 'encoding', it, f'one of mono8, .* got {it!r}')
        for it in ('', '32FC1', 'bayer_rggb', 'nv99', 'mono16', 'bayer_rggb16', 'nv24')
    ),
    *((read.gray, image, side, 0, 'image is empty') for side in ('width', 'height')),
    (read.camera, info, 'k.0', 0.0, r'K\[0\] = 0 means an uncalibrated camera'),
    (read.camera, info, 'k.0', -400.0, 'focal lengths must be positive'),
    (read.camera, info, 'k.2', math.inf, 'intrinsics must be finite'),
    (read.camera, info, 'k.1', 200.0, r'the skew must be small, got K\[1\] = 200 px'),
    *((read.camera, info, f'k.{it}', NAN, 'intrinsics must be finite') for it in range(9)),
    *((read.camera, info, f'k.{it}', 0.5, ROWS) for it in (3, 6, 7)),
    (read.camera, info, 'k.8', 0.0, ROWS),
    (read.camera, info, 'width', 0, 'image size must be positive'),
    *(
        (read.features, tracks, 'fields', [it for it in tracks().fields if it.name != name], words)
        for name in read.TRACK_FIELDS
        for words in (f'missing {name};',)
    ),
    (read.features, tracks, 'data', tracks().data[:-1], '2 rows of 60 bytes, got 119 bytes'),
    *((read.features, tracks, 'fields.1.datatype', it, 'datatype: u;') for it in (0, 9, 255)),
    (read.features, tracks, 'fields.1.offset', 53, 'requires 61 bytes'),
    (read.features, tracks, 'point_step', 0, 'requires 48 bytes'),
    (read.features, nowhere, 'header.frame_id', 'camera', 'current must be finite, got 1 rows'),
    *((read.twist, twist, 'angular.z', it, 'must be finite') for it in INFINITE),
    *((read.twist, stamped, 'twist.angular.z', it, 'must be finite') for it in INFINITE),
    (read.pose, odometry, 'pose.pose.position.x', NAN, 'a pose must be finite'),
    (read.pose, odometry, 'pose.pose.orientation.w', NAN, f'{QUATERNION} nan'),
    (read.pose, odometry, 'pose.pose.orientation.w', 0.0, f'{QUATERNION} 0'),
    (read.diagnosis, DiagnosticArray, 'status', [], 'must have a status'),
    (read.telemetry, numbers, 'name', ['a', 'b'], 'shorter'),
]


@pytest.mark.parametrize(('reader', 'made', 'path', 'value', 'words'), REFUSED)
def test_what_cannot_be_used_is_refused(reader, made, path, value, words) -> None:
    message = made()
    put(message, path, value)
    with pytest.raises(ValueError, match=words):
        reader(message)


CAMERA = Camera(640, 480, 400.0, 400.0, 319.5, 239.5)
INSIDE = [[10.0, 10.0], [20.0, 20.0]]


def features(u: float, *, of_desired: bool) -> Features:
    moved = [[u, 10.0], [20.0, 20.0]]
    current, desired = (INSIDE, moved) if of_desired else (moved, INSIDE)
    return Features(ids=[1, 2], current=current, desired=desired, ages=[1, 1], errors=[0, 0])


@pytest.mark.parametrize('of_desired', [False, True])
@pytest.mark.parametrize(('u', 'count'), [(-0.9, 2), (639.9, 2), (-3.0, 0), (642.0, 0)])
def test_a_feature_may_lie_a_pixel_outside_and_no_more(u, count, of_desired) -> None:
    taken, warning = checked_features(features(u, of_desired=of_desired), CAMERA)
    assert len(taken) == count
    expected = 'tracks refused: 1 of 2 features lie outside an image of 640x480 px; connect'
    assert warning.startswith(expected) if count == 0 else warning == ''


def test_tracks_of_others_are_refused_with_the_reason() -> None:
    twice = replace(features(10.0, of_desired=False), ids=[1, 1])
    _, warning = checked_tracks(write.features(twice, 0, 'camera'), CAMERA)
    assert warning.startswith('tracks refused: of 2 ids 1 differ')


def test_photographs_that_a_new_camera_cannot_use_stay_whole(monkeypatch) -> None:
    rng = np.random.default_rng(3)
    image = cv2.resize(rng.integers(0, 255, (32, 64), np.uint8), (640, 320))
    tracker = Tracker(TrackerSettings())
    tracker.set_desired(image)
    tracker.add_desired(cv2.convertScaleAbs(image, alpha=0.6))
    tracker.track(image)
    kept, goal = tracker.photographs, tracker.goal

    def refuse(*arguments) -> None:
        raise TrackingError('the second photograph cannot be tied')

    monkeypatch.setattr(photographs, 'tied', refuse)
    message = write.image(image, 'mono8', 1, 'camera')
    refused = track(tracker, message, of_size(640, 320))
    assert 'the second photograph cannot be tied' in refused.warning and not len(refused.features)
    assert tracker.photographs is kept and tracker.goal is goal
    pinhole = Camera(640, 320, 400.0, 400.0, 319.5, 159.5)
    assert len(track(tracker, message, pinhole).features) > 8
    monkeypatch.undo()
    assert len(track(tracker, message, of_size(640, 320)).features) > 8
    assert len(tracker.photographs) == 2 and tracker.goal is not goal
