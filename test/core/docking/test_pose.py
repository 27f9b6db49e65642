"""The dock's pose in metres: right within what it says of itself, and silent before it knows."""

from dataclasses import replace
import math

from docking_drives import CAMERA, Drive, EXACT, NOISE, PERIOD_NS, PERIOD_S, true_dock
import numpy as np
import pytest

from visual_servo_epipolar.core.docking.pose import DockPoseSettings, update_search
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, Twist
from visual_servo_epipolar.core.odometry.path import PathPlace
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.twoview.observation import observe
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld
from visual_servo_epipolar.simulation.rigs import CameraMount, SimulatedRig

SETTINGS = DockPoseSettings(path_deviation=NOISE, floor_jitter=1e-4, pixel_noise=0.2, **EXACT)
RUNS, FRAMES = 24, 14


def error(dock, pose):
    apart = dock.pose - true_dock(pose)
    apart[2] = math.remainder(apart[2], 2.0 * math.pi)
    return apart


def start(seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.4, 0.4), rng.uniform(-2.0, -1.6), rng.uniform(-8.0, 8.0)


def normalised(drive, settings=SETTINGS, frames=FRAMES):
    """Return the square of the normalised error at the end, over its three degrees of freedom."""
    *_, (search, pose) = drive.searched(settings, frames)
    apart = error(search.estimate, pose)
    return apart @ np.linalg.solve(search.estimate.covariance, apart) / 3.0


@pytest.mark.long
def test_its_covariance_is_honest_whatever_is_driven() -> None:
    # 72 squares of unit deviation on average 1, their root within 0.09 of it by chance
    drives = [
        Drive(start=start(seed), seed=seed, angular=0.3 * (seed % 3 - 1)) for seed in range(RUNS)
    ]
    assert 0.9 < math.sqrt(np.mean([normalised(drive) for drive in drives])) < 1.2


def test_driving_straight_at_the_dock_tells_how_far_it_is() -> None:
    # The bearing never changes there: each feature moves by its own depth.
    *_, (search, pose) = Drive(start=(0.0, -2.0, 0.0), seed=1).searched(SETTINGS, FRAMES)
    assert search.dock is not None
    assert search.dock.deviation < 0.01
    assert np.abs(error(search.dock, pose)[:2]).max() < 0.02


@pytest.mark.parametrize('most', [SETTINGS.publish_deviation, 0.008])
def test_nothing_is_published_before_its_deviation_is_below_the_setting(most: float) -> None:
    published, settings = [], replace(SETTINGS, publish_deviation=most)
    for search, pose in Drive(start=(0.3, -2.0, 4.0), seed=2).searched(settings, FRAMES):
        published.append(search.dock is not None)
        assert (search.dock is None) == bool(search.reason)
        if search.dock is not None:
            assert search.dock.deviation <= most
            assert np.abs(error(search.dock, pose)[:2]).max() < 4.0 * most
    assert not published[0] and not published[1]
    assert published[-1]


def test_a_robot_that_stands_publishes_nothing() -> None:
    *_, (search, _) = Drive(start=(0.5, -2.0, 5.0), linear=0.0, seed=3).searched(SETTINGS, 8)
    assert search.dock is None
    assert 'has not moved yet' in search.reason


@pytest.mark.parametrize(
    ('mount', 'linear', 'heading'),
    [
        (CameraMount(forward=0.2, left=-0.1, yaw=0.3, tilt=0.2, roll=0.05), 0.4, -17.0),
        (CameraMount(yaw=math.pi, forward=-0.2), -0.4, 180.0),
    ],
    ids=['ahead, aside and tilted', 'looks back'],
)
def test_the_pose_is_that_of_the_base_however_the_camera_sits(mount, linear, heading) -> None:
    settings = replace(
        SETTINGS,
        camera_forward=mount.forward,
        camera_left=mount.left,
        camera_yaw=mount.yaw,
        camera_tilt=mount.tilt,
        camera_roll=mount.roll,
    )
    begin = (0.2, -2.0, 3.0) if linear > 0.0 else (0.2, 2.0, 3.0)
    drive = Drive(start=begin, seed=4, linear=linear, angular=0.1, mount=mount)
    *_, (search, pose) = drive.searched(settings, FRAMES)
    assert search.dock is not None
    assert np.abs(error(search.dock, pose)[:2]).max() < 4.0 * search.dock.deviation
    assert search.dock.deviation < 0.03


def test_what_is_not_known_of_the_mount_is_found_out_on_the_way() -> None:
    drive = Drive(start=(0.4, -2.0, 4.0), seed=5, angular=0.2, mount=CameraMount(yaw=0.05))
    aside = []
    for deviation in (0.05, 1e-4):
        settings = replace(SETTINGS, camera_yaw_deviation=deviation)
        *_, (search, pose) = drive.searched(settings, FRAMES)
        aside.append(abs(error(search.estimate, pose)[1]))
        if deviation == 0.05:
            assert aside[0] < 4.0 * search.estimate.deviation
    assert aside[0] < 0.3 * aside[1]


def test_wrong_matches_do_not_make_it_wrong() -> None:
    drive = Drive(start=(0.3, -2.0, 4.0), seed=6, points=PointSettings(outlier_ratio=0.2))
    *_, (search, pose) = drive.searched(SETTINGS, FRAMES)
    assert search.dock is not None
    apart = error(search.dock, pose)
    assert apart @ np.linalg.solve(search.dock.covariance, apart) < 16.0


WORLD = PointWorld(PointSettings(), SimulatedRig(CAMERA), seed=7)


def look(search, pose, place, goal=0):
    seen = observe(WORLD.observe(pose, search.servo.view.frame), CAMERA, place.stamp_ns)
    return update_search(search, seen, place, SETTINGS, goal=goal)


@pytest.fixture(scope='module')
def known():
    """Return a search that knows the dock, and where the base is."""
    *_, last = Drive(start=(0.3, -2.0, 4.0), seed=7).searched(SETTINGS, FRAMES)
    return last


def place_after(search, **changes):
    last = search.last
    return replace(last, stamp_ns=last.stamp_ns + 1, **changes)


@pytest.mark.parametrize('what', ['another photograph', 'odometry that leapt'])
def test_what_goes_together_no_more_is_forgotten(known, what) -> None:
    search, pose = known
    leapt = what == 'odometry that leapt'
    search = look(search, pose, place_after(search), goal=1)
    assert search.dock is not None
    after = look(search, pose, place_after(search, epoch=int(leapt)), goal=2 - leapt)
    assert after.dock is None
    assert after.views == 1


def test_without_features_there_is_no_pose_and_it_comes_back_with_them(known) -> None:
    search, pose = known
    none = update_search(search, observe(Features(), CAMERA, 1), place_after(search), SETTINGS)
    assert none.dock is None
    assert 'features' in none.reason
    assert look(none, pose, place_after(search)).dock is not None


def test_what_is_out_of_view_for_a_bend_is_remembered(known) -> None:
    search, start = known
    told = Pose(*search.last.pose.tolist())
    pose, place = start, search.last
    for angular in (*[-1.2] * 8, *[1.2] * 8):  # to the right and back, 1.3 m ahead in all
        twist = Twist(-0.4, angular)
        pose, told = (integrate(it, twist, PERIOD_S) for it in (pose, told))
        told_pose = np.array([told.x, told.y, told.theta])
        place = PathPlace(place.stamp_ns + PERIOD_NS, told_pose, place.epoch)
        search = update_search(search, observe(Features(), CAMERA, 1), place, SETTINGS)
        assert search.dock is None
    search = look(search, pose, place)
    assert search.dock is not None
    assert np.abs(error(search.dock, pose)[:2]).max() < 4.0 * search.dock.deviation


def test_odometry_that_lies_is_found_out(known) -> None:
    # It says that the base stood, while it went on by 30 cm.
    search, pose = known
    ahead = Pose(pose.x - 0.1, pose.y + 0.3, pose.theta)
    place = place_after(search)
    for _ in range(12):
        search = look(search, ahead, place)
        assert search.dock is None
    assert search.views < 2  # it has begun anew
