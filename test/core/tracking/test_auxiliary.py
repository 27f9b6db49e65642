"""Auxiliary features: followed where the photograph's are not, renewed before they drift away."""

from dataclasses import replace

import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, integrate, Pose, Twist
from visual_servo_epipolar.core.tracking.auxiliary import (
    AuxiliaryTracker,
    BORDER,
    LAST_ID,
    OLD,
    PERIOD,
    SPACING,
    TWIN_PX,
)
from visual_servo_epipolar.core.tracking.features import AuxiliaryFeatures, FIRST_AUXILIARY
from visual_servo_epipolar.core.tracking.flow import Frame
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator

LIMIT = 20
SETTINGS = TrackerSettings(auxiliary_features=LIMIT)
NOWHERE = np.empty((0, 2))


@pytest.fixture(scope='module')
def drive(world: CameraSimulator) -> list[tuple[Pose, np.ndarray]]:
    """Return thirty frames of an approach from 3 m behind the goal."""
    pose, frames = Pose(0.3, -3.0, DESIRED_POSE.theta + 0.05), []
    for number in range(30):
        frames.append((pose, world.capture(pose, number)))
        pose = integrate(pose, Twist(0.4, 0.02), 0.1)
    return frames


def tracked(world: CameraSimulator, drive, settings: TrackerSettings = SETTINGS) -> list:
    tracker = Tracker(settings)
    tracker.set_desired(world.photograph())
    return [tracker.track(image) for _, image in drive]


def test_they_stay_on_their_points(world: CameraSimulator, drive) -> None:
    found = tracked(world, drive)
    first: dict[int, tuple[Pose, np.ndarray]] = {}
    errors = []
    for (pose, _), features in zip(drive, found, strict=True):
        assert len(features.auxiliary) <= LIMIT
        for number, pixel in zip(
            features.auxiliary.ids.tolist(), features.auxiliary.current, strict=True
        ):
            if number not in first:
                first[number] = pose, pixel
                continue
            point = world.renderer.trace(first[number][1][None], first[number][0])
            truth, _ = world.renderer.project(point, pose)
            errors.append(float(np.hypot(*(truth[0] - pixel))))
    assert len(errors) > 10 * LIMIT
    assert np.median(errors) < 0.5
    assert np.quantile(errors, 0.9) < 2.0


def test_they_are_none_of_the_photograph_s_and_stand_apart(world: CameraSimulator, drive) -> None:
    for features in tracked(world, drive)[:8]:
        auxiliary = features.auxiliary
        assert (auxiliary.ids >= FIRST_AUXILIARY).all()
        assert not set(auxiliary.ids.tolist()) & set(features.ids.tolist())
        apart = np.hypot(*(auxiliary.current[:, None] - features.current).T)
        assert apart.min() >= TWIN_PX
        assert (auxiliary.current > BORDER).all()


def test_the_photograph_s_features_are_the_same_with_and_without(world, drive) -> None:
    with_them = tracked(world, drive)
    without = tracked(world, drive, replace(SETTINGS, auxiliary_features=0))
    for one, other in zip(with_them, without, strict=True):
        assert len(other.auxiliary) == 0
        for name in ('ids', 'current', 'desired', 'ages', 'errors'):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_the_old_are_let_go_one_at_a_time_and_only_where_others_are_seen(drive) -> None:
    frame = Frame(drive[0][1])
    for known in (np.full((SETTINGS.min_features, 2), 5.0), NOWHERE):
        follower, before, let_go = AuxiliaryTracker(), set[int](), 0
        for _ in range(OLD + 4 * PERIOD):
            auxiliary = set(follower.follow(frame, frame, known, SETTINGS).ids.tolist())
            assert len(auxiliary) > LIMIT // 2
            assert len(before - auxiliary) <= 1
            let_go, before = let_go + len(before - auxiliary), auxiliary
        assert (let_go > 0) == (len(known) > 0)
    assert not len(follower.follow(frame, frame, NOWHERE, replace(SETTINGS, auxiliary_features=0)))


def test_they_are_spread_and_leave_the_photograph_s_features_alone(drive) -> None:
    frame = Frame(drive[0][1])
    known = np.array([[200.0, 240.0], [440.0, 240.0]])
    auxiliary = AuxiliaryTracker().follow(None, frame, known, SETTINGS)
    height, width = frame.image.shape
    spacing = SPACING * np.sqrt(height * width / LIMIT)
    apart = np.hypot(*(auxiliary.current[:, None] - auxiliary.current).T)
    assert apart[~np.eye(len(auxiliary), dtype=bool)].min() >= spacing - 1.0
    assert np.hypot(*(auxiliary.current[:, None] - known).T).min() >= 0.5 * spacing - 1.0


def test_another_stream_begins_anew(drive) -> None:
    follower, frame = AuxiliaryTracker(), Frame(drive[0][1])
    before = follower.follow(None, frame, NOWHERE, SETTINGS)
    follower.forget()
    assert len(before) > LIMIT // 2
    assert len(follower.features) == 0


def test_numbers_begin_again_before_they_are_too_large_for_a_row(drive) -> None:
    follower, frame = AuxiliaryTracker(), Frame(drive[0][1])
    follower._next_id = LAST_ID - 1
    auxiliary = follower.follow(None, frame, NOWHERE, SETTINGS)
    assert auxiliary.ids.min() == FIRST_AUXILIARY
    assert auxiliary.ids.max() < LAST_ID


def test_who_begins_anew_gives_other_numbers(drive) -> None:
    streams = [drive[number][1] for number in (0, 5)]
    first, second, again = (
        set(AuxiliaryTracker().follow(None, Frame(image), NOWHERE, SETTINGS).ids.tolist())
        for image in (*streams, streams[0])
    )
    assert not first & second
    assert first == again


def test_an_image_without_corners_has_none() -> None:
    grey = Frame(np.full((480, 640), 90, np.uint8))
    assert len(AuxiliaryTracker().follow(None, grey, NOWHERE, SETTINGS)) == 0


def test_rows_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match='ages must have 2 rows to match ids, got 1'):
        AuxiliaryFeatures([1, 2], np.zeros((2, 2)), [3])
