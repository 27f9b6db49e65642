"""Several photographs of one pose: the one that fits is tracked, to where the first is."""

from dataclasses import replace
import math

import numpy as np
import pytest

from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.goal import goal_id
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.tracking.photographs.averaging import averaged
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator, ImageView
from visual_servo_epipolar.simulation.closed_loop import run
from visual_servo_epipolar.simulation.light import LightSettings
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.run_monitor import LoopSettings

CAMERA = CameraSettings(
    width=640, height=480, focal_length=384.6, principal_u=319.5, principal_v=239.5
)
NEAR = Pose(0.1, -1.0, DESIRED_POSE.theta)
AT_GOAL = Pose(0.002, -0.005, DESIRED_POSE.theta)


@pytest.fixture(scope='module')
def dusk() -> CameraSimulator:
    """Return a room of which the photograph is from noon, and all else from dusk."""
    light = LightSettings(photograph_light='noon', light='dusk', exposure='auto')
    return CameraSimulator(CAMERA, None, light)


@pytest.fixture(scope='module')
def evening(dusk: CameraSimulator) -> np.ndarray:
    """Return a photograph from dusk, taken where a robot arrived."""
    return dusk.capture(Pose(0.001, -0.001, DESIRED_POSE.theta + math.radians(0.02)), 0)


@pytest.fixture(scope='module')
def both(dusk: CameraSimulator, evening: np.ndarray) -> Tracker:
    """Return a tracker that knows both photographs."""
    tracker = Tracker(TrackerSettings())
    tracker.set_desired(dusk.photograph())
    tracker.add_desired(evening)
    return tracker


@pytest.fixture
def taught(both: Tracker) -> Tracker:
    """Return that tracker, to begin anew."""
    both.redetect()
    return both


def test_the_photograph_in_todays_light_is_tracked_to_where_the_first_was(dusk, taught) -> None:
    alone = Tracker(TrackerSettings())
    alone.set_desired(dusk.photograph())
    features = taught.track(dusk.capture(NEAR, 1))
    assert taught.which == 'photograph 2 of 2'
    assert len(features) >= len(alone.track(dusk.capture(NEAR, 1)))
    assert features.goal == alone.goal.id
    truth, _ = dusk.renderer.project(dusk.renderer.trace(features.current, NEAR), DESIRED_POSE)
    off = features.desired - truth
    assert np.abs(np.median(off, axis=0)).max() < 0.03  # a third of a millimetre at 3 m
    dusk.relight(replace(dusk.light, light='noon'))
    taught.redetect()
    ids = taught.track(dusk.capture(NEAR, 2)).ids
    dusk.relight(replace(dusk.light, light='dusk'))
    assert taught.which == 'photograph 1 of 2'
    assert not set(ids) & set(features.ids)  # an id is one point of one photograph


def test_light_that_changes_on_the_way_changes_the_photograph(dusk, taught) -> None:
    taught.track(dusk.capture(NEAR, 1))
    blind = np.full((480, 640), 128, np.uint8)
    for _ in range(3):
        taught.track(blind)
    dusk.relight(replace(dusk.light, light='noon'))
    for frame in range(12):
        features = taught.track(dusk.capture(NEAR, frame))
    dusk.relight(replace(dusk.light, light='dusk'))
    assert len(features) >= 30
    assert taught.which == 'photograph 1 of 2'


@pytest.mark.parametrize(
    ('x', 'heading', 'reason'),
    [
        (0.2, 0.0, 'from another pose than the first'),
        (0.0, 5.0, 'from another pose than the first'),
        (0.0, 180.0, 'does not show what the first'),
    ],
)
def test_a_photograph_of_another_pose_is_refused(dusk, taught, x, heading, reason) -> None:
    elsewhere = dusk.capture(Pose(x, 0.0, DESIRED_POSE.theta + math.radians(heading)), 0)
    photographs = taught.photographs
    with pytest.raises(TrackingError, match=reason):
        taught.add_desired(elsewhere)
    assert taught.photographs is photographs


def test_a_further_photograph_needs_a_first_one_of_its_size(taught, evening) -> None:
    with pytest.raises(ValueError, match='no desired image yet'):
        Tracker(TrackerSettings()).add_desired(evening)
    with pytest.raises(ValueError, match='must have the size of the first, 640x480, got 600x480'):
        taught.add_desired(evening[:, :600])


DAY = 'noon', 'dusk', 'lamp_right', 'lamp_side', 'dark'


@pytest.mark.parametrize(
    ('lights', 'times'), [(DAY[1::3], 1), pytest.param(DAY, 20, marks=pytest.mark.long)]
)
def test_arrivals_through_a_day_of_light_do_not_move_the_goal(dusk, lights, times) -> None:
    view, rng = ImageView(dusk, Tracker(TrackerSettings())), np.random.default_rng(1)
    tracker, light = view.tracker, dusk.light
    for arrival, now in enumerate(np.repeat(lights, times)):
        dusk.relight(replace(light, light=str(now)))
        tracker.redetect()
        start = rng.uniform(-0.2, 0.2), rng.uniform(-1.0, -0.7), rng.uniform(-4.0, 4.0)
        settings = LoopSettings(start=start, seed=arrival, servo=ServoSettings(law='smooth'))
        log = run(settings, view, dusk.camera)
        end = log.samples[-1].pose
        assert math.hypot(end.x, end.y) < 0.003
        if (now, arrival % times) == ('dusk', 1):
            assert tracker.which.startswith('photograph 2')
        tracker.renew(averaged([dusk.capture(end, 1000 + k) for k in range(10)]), 4)
    dusk.relight(light)
    assert len(tracker.photographs) == min(1 + len(set(lights) - {'noon'}), 4)
    assert tracker.goal.id == goal_id(dusk.photograph())


def test_ids_of_a_photograph_follow_from_it(dusk, evening, both) -> None:
    tracker = Tracker(TrackerSettings())
    tracker.set_desired(dusk.photograph())
    tracker.add_desired(evening)
    first, second = (each.photographs.views[1].first_id for each in (tracker, both))
    assert first == second > len(both.photographs.views[0].first_pixels)
