"""Tracks that cannot be of the camera are refused, with the reason."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from visual_servo_epipolar.core.cameras.equirectangular import of_size
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.perception.observation import observe
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.photographs import photographs
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.messages.tracking import track
from visual_servo_epipolar.messages.validation import checked_features, checked_tracks, left_out

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


def test_ids_that_stand_twice_are_refused() -> None:
    taken, warning = checked_features(
        replace(features(10.0, of_desired=False), ids=[1, 1]), CAMERA
    )
    assert len(taken) == 0
    assert warning.startswith('tracks refused: of 2 ids 1 differ')


def test_a_cloud_that_is_none_of_tracks_is_refused_with_the_reason() -> None:
    message = write.features(features(10.0, of_desired=False), 0, 'camera')
    assert len(checked_tracks(message, CAMERA)[0]) == 2
    message.fields = []
    taken, warning = checked_tracks(message, CAMERA)
    assert len(taken) == 0
    assert warning.startswith('tracks refused: tracks must have the fields id, u, v')


def test_where_the_lens_places_all_nothing_is_said() -> None:
    observation = observe(features(10.0, of_desired=False), CAMERA, 0)
    assert left_out(observation, CAMERA) == ''


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
