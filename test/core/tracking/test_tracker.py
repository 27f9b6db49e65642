"""The tracker on rendered images: it finds, follows, does not drift, and says what it lost."""

from dataclasses import replace

import cv2
from durations import few_of
import numpy as np
import pytest
from small_cameras import sized

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, integrate, Pose, Twist
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings

SETTINGS = TrackerSettings()


@pytest.fixture(scope='module')
def approach(world: CameraSimulator) -> list[tuple[Pose, np.ndarray]]:
    """Return forty frames of an approach that ends at the goal."""
    pose, frames = Pose(0.0, -1.6, DESIRED_POSE.theta), []
    for number in range(41):
        frames.append((pose, world.capture(pose, number)))
        pose = integrate(pose, Twist(0.4, 0.0), 0.1)
    return frames


def tracker(world: CameraSimulator, **changes) -> Tracker:
    new = Tracker(replace(SETTINGS, **changes))
    new.set_desired(world.photograph())
    return new


def errors(world: CameraSimulator, features, pose: Pose) -> np.ndarray:
    """Return the distance of each feature from where the scene says it is [px]."""
    points = world.renderer.trace(features.desired, DESIRED_POSE)
    truth, _ = world.renderer.project(points, pose)
    return np.hypot(*(truth - features.current).T)


def test_without_a_photograph_there_are_no_features_and_the_reason_is_said(world) -> None:
    bare = Tracker(SETTINGS)
    assert bare.reason.startswith('no desired image yet; ')
    assert len(bare.track(world.photograph())) == 0
    assert tracker(world).reason == 'the photograph was not looked for yet'
    with pytest.raises(ValueError, match='min_features must lie in .1, 1000., got 0'):
        tracker(world, min_features=0)


@pytest.mark.parametrize('changes', [{'min_features': 1}, {'search_per_frame': 0}])
def test_with_the_least_that_may_be_asked_for_it_is_not_blind(world, approach, changes) -> None:
    assert len(tracker(world, **changes).track(approach[0][1])) >= 20


def test_the_photograph_itself_is_found_where_it_is_by_features_all_over_it(world) -> None:
    features = tracker(world).track(world.photograph())
    assert len(features) == SETTINGS.max_features
    assert np.abs(features.current - features.desired).max() < 1e-3
    quarters = {(u > 320, v > 240) for u, v in features.desired}
    assert len(quarters) == 4


def test_features_keep_place_identity_and_age_on_the_way_to_the_goal(world, approach) -> None:
    tracking, meaning = tracker(world), {}
    for number, (pose, image) in enumerate(approach):
        features = tracking.track(image)
        assert np.nanmedian(errors(world, features, pose)) < 0.15  # half the resolution
        assert number > 3 or features.ages.max() == number  # frames since it was found
        for key, pixel in zip(features.ids, features.desired, strict=True):
            assert meaning.setdefault(int(key), tuple(pixel)) == tuple(pixel)
    assert len(features) >= 26
    assert np.median(errors(world, features, pose)) < 0.06


def test_a_sudden_change_of_light_is_survived(world, approach) -> None:
    tracking = tracker(world)
    for number, (pose, image) in enumerate(approach[:16]):  # noqa: B007
        dimmed = (image * 0.7).astype(np.uint8) if number >= 8 else image
        features = tracking.track(dimmed)
        assert len(features) >= 26
    assert np.nanmedian(errors(world, features, pose)) < 0.2


def test_hidden_features_are_reacquired(world, approach) -> None:
    tracking = tracker(world, min_features=1)
    for number, (_, image) in enumerate(approach[:24]):
        hidden = image.copy()
        if 6 <= number < 12:
            hidden[:, 320:] = 90
        features = tracking.track(hidden)
        if number == 11:
            assert not (features.current[:, 0] > 320).any()
    assert (features.current[:, 0] > 320).sum() >= 5
    assert tracking.matchings == 1  # by prediction and search


def test_a_view_of_nothing_loses_everything_and_tracking_resumes(world, approach) -> None:
    tracking = tracker(world)
    tracking.track(approach[0][1])
    for _ in range(12):
        assert len(tracking.track(np.full((480, 640), 90, np.uint8))) == 0
    assert 'not seen' in tracking.reason
    for _, image in approach[1:16]:
        features = tracking.track(image)
    assert len(features) >= 26


@pytest.mark.parametrize('changes', few_of([{}, {'anchor_period': 5}], keep=(1,)))
def test_the_same_images_give_the_same_features_prepared_or_not(world, approach, changes) -> None:
    prepared, at_once = tracker(world, **changes), tracker(world, **changes)
    for number, (_, image) in enumerate(approach):
        if 10 <= number < 13:  # and what is lost is found again alike
            image = image.copy()
            image[:, :400] = 128
        prepared.prepare()
        pair = prepared.track(image), at_once.track(image)
        for name in ('ids', 'current', 'ages', 'errors'):
            np.testing.assert_array_equal(*(getattr(features, name) for features in pair))


def test_without_anchoring_features_are_checked_backward(world, approach) -> None:
    tracking = tracker(world, anchor_period=0)
    for pose, image in approach[:10]:  # noqa: B007
        features = tracking.track(image)
    assert np.nanmedian(errors(world, features, pose)) < 1.0


def reduced(image: np.ndarray, width: int) -> np.ndarray:
    return cv2.resize(image, (width, 3 * width // 4), interpolation=cv2.INTER_AREA)


@pytest.mark.parametrize(('width', 'most'), [(640, 60), (320, 157)])
def test_more_of_the_smaller_features_of_a_small_image_are_tracked(world, width, most) -> None:
    small, tracking = reduced(world.photograph(), width), Tracker(SETTINGS)
    tracking.set_desired(small)
    assert len(tracking.track(small)) == most


def test_features_that_no_descriptor_finds_are_found_beside_others(world, approach) -> None:
    pose, image = approach[0]
    counts = []
    for enough in (1, 60):
        tracking = Tracker(replace(SETTINGS, min_features=enough))
        tracking.set_desired(reduced(world.photograph(), 160))
        features = tracking.track(reduced(image, 160))
        pixels = {it: 4.0 * getattr(features, it) + 1.5 for it in ('current', 'desired')}
        assert np.nanmedian(errors(world, replace(features, **pixels), pose)) < 1.2
        counts.append(len(features))
    assert counts[0] < counts[1]


@pytest.fixture(scope='module')
def world() -> CameraSimulator:
    return CameraSimulator(CameraSettings(**sized(640, 480, 384.6, 319.5, 239.5)))
