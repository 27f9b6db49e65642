"""Two views by other lenses, and by one that is told wrong."""

from dataclasses import replace
import math

import cv2
import numpy as np
import pytest
from strategies import blurred, CAMERA, matches, seen_from, through_lens

from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, integrate, Pose, Twist
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import step
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.twoview.lens_check import contradicted_by_pair
from visual_servo_epipolar.core.twoview.measurement import (
    difference_deviation,
    feature_difference,
    usual_difference,
)
from visual_servo_epipolar.core.twoview.observation import Observation, observe
from visual_servo_epipolar.core.twoview.perceive import perceive
from visual_servo_epipolar.core.twoview.rolling_shutter import base_axes, RollingShutter
from visual_servo_epipolar.simulation.closed_loop import Loop
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld
from visual_servo_epipolar.simulation.rigs import CameraMount, SimulatedRig
from visual_servo_epipolar.simulation.scenario import from_document, Scenario
from visual_servo_epipolar.simulation.sensor import CameraMotion, Shutter
from visual_servo_epipolar.simulation.views import points_of

SIZE = {'width': 1280, 'height': 1024}
FOLDING = Camera(**SIZE, fx=769.0, fy=769.0, cx=635.0, cy=512.0, distortion=(-0.45, 0.0, 0.0, 0.0))
FISHEYE = Equidistant(**SIZE, fx=396.0, fy=396.0, cx=639.5, cy=511.5)


def features(count: int = 50, seed: int = 0) -> Features:
    """Return features anywhere in the image."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform(0.0, 1.0, (2, count, 2)) * [1279.0, 1023.0]
    numbers = np.arange(count)
    return Features(numbers, pixels[0], pixels[1], numbers, np.zeros(count))


def test_what_the_lens_cannot_place_is_dropped_from_both_views() -> None:
    seen = features()
    usable = [
        FOLDING.round_trips(pixels, FOLDING.rays(pixels))
        for pixels in (seen.current, seen.desired)
    ]
    kept = usable[0] & usable[1]
    assert 0 < kept.sum() < usable[0].sum() < len(seen)
    observation = observe(seen, FOLDING, 7)
    assert (observation.dropped, len(observation)) == (len(seen) - kept.sum(), kept.sum())
    np.testing.assert_array_equal(observation.current, FOLDING.rays(seen.current[kept]))
    np.testing.assert_array_equal(observation.desired, FOLDING.rays(seen.desired[kept]))
    resolution = FOLDING.resolution(observation.desired)
    np.testing.assert_array_equal(observation.resolution[:, 1], resolution)
    assert np.isfinite(observation.resolution).all()


@pytest.mark.parametrize(
    'camera',
    [
        replace(FOLDING, distortion=(-0.2, 0.05, 0.0, 0.0)),
        replace(FOLDING, distortion=()),
        FISHEYE,
    ],
)
def test_of_a_lens_that_places_all_nothing_is_dropped(camera) -> None:
    observation = observe(features(), camera, 0)
    assert (observation.dropped, len(observation)) == (0, 50)
    assert observation.wide == (camera is FISHEYE)


def test_nothing_that_is_seen_leaves_an_empty_observation() -> None:
    seen = features()
    corners = replace(seen, current=np.full((50, 2), 3.0), desired=np.full((50, 2), 3.0))
    observation = observe(corners, FOLDING, 0)
    assert (observation.dropped, len(observation)) == (50, 0)
    perception = perceive(observation, ServoSettings(), 0)
    assert perception.measurement.reason.startswith('0 features')


def sphere(count: int = 200) -> np.ndarray:
    """Return points all around, 3 to 8 m away, in axes of the camera at the goal."""
    rng = np.random.default_rng(1)
    points = normalised(rng.standard_normal((count, 3)))
    return np.asarray(points * rng.uniform(3.0, 8.0, (count, 1)))


def test_d_of_the_sphere_is_that_of_the_plane_at_small_angles() -> None:
    points = np.array([[0.02, 0.01, 3.0], [-0.03, 0.02, 4.0]])
    current, desired = normalised(points - [0.0, 0.0, 0.3]), normalised(points)
    plane, wide = (feature_difference(current, desired, kind) for kind in (False, True))
    assert wide == pytest.approx(plane, rel=1e-3)


@pytest.mark.parametrize('part', ['all around', 'behind alone'])
def test_d_of_the_sphere_falls_with_the_distance_to_the_goal_from_either_side(part: str) -> None:
    points = sphere()
    points = points[points[:, 2] < 0.0] if part == 'behind alone' else points
    desired = normalised(points)
    values = [
        float(feature_difference(normalised(points - [0.0, 0.0, z]), desired, True))
        for z in np.linspace(-2.0, 2.0, 21)
    ]
    assert (np.diff(values) > 0.0).all()
    assert values[10] == 0.0


def test_the_stated_deviation_of_d_is_what_noise_makes() -> None:
    rng, desired = np.random.default_rng(2), normalised(sphere(60))
    values = []
    for _ in range(2000):
        both = (normalised(desired + 1e-3 * rng.standard_normal(desired.shape)) for _ in range(2))
        values.append(float(usual_difference(*both, True)))
    stated = float(difference_deviation(desired, desired, 1e-3, True))
    assert float(np.std(values)) == pytest.approx(stated, rel=0.1)


CHEAP = {
    **{'width': 640, 'height': 480, 'focal_length': 384.6, 'frame_rate': 15.0},
    **{'principal_u': 317.25, 'principal_v': 239.75},
}
START = (0.1, -0.5, 5.0)


def in_a_room(scenario: Scenario) -> PointWorld:
    """Return points of a floor 0.6 m below, and of a wall 5 m ahead, as the goal sees them."""
    world = points_of(scenario, 0)
    axes, centre = world.rig.camera_pose(DESIRED_POSE)
    rays = (world.points - centre) @ axes
    depth = np.minimum(5.0, 0.6 * rays[:, 2] / np.maximum(rays[:, 1], 1e-9))
    world.points = centre + (rays * (depth / rays[:, 2])[:, None]) @ axes.T
    return world


def driven(true: float, told: float) -> RollingShutter:
    """Return the estimate of a run with a ``true`` readout, and one that is ``told``."""
    document = {
        'camera': {**CHEAP, 'readout': true},
        'servo': {'law': 'full', 'readout': told},
        'run': {'max_duration': 1.2},
    }
    scenario = from_document(document, 'test')
    shutters = [RollingShutter()]

    def control(state: ServoState, seen: Observation, settings: ServoSettings) -> ServoState:
        after = step(state, seen, settings)
        assert after.view.memory is not None
        shutters.append(after.view.memory.shutter)
        return after

    loop, camera = scenario.loop(START, 0), scenario.camera.camera
    Loop(loop, in_a_room(scenario), camera).run(control=control)
    return shutters[-1]


@pytest.mark.parametrize('tilt', [0.0, 0.2])
def test_rows_of_a_camera_that_turns_are_put_back_to_one_instant(tilt: float) -> None:
    rig, twist, readout = SimulatedRig(CAMERA, CameraMount(tilt=tilt)), Twist(0.0, 1.0), 0.033
    exact = PointSettings(noise=0.0)
    rolling = PointWorld(exact, rig, seed=0, shutter=Shutter(readout))
    seen = observe(rolling.observe(DESIRED_POSE, 0, CameraMotion(twist)), CAMERA, 0)
    then = integrate(DESIRED_POSE, twist, 0.5 * readout)
    expected = observe(PointWorld(exact, rig, seed=0).observe(then, 0), CAMERA, 0)
    _, here, there = np.intersect1d(seen.ids, expected.ids, return_indices=True)
    up = np.array([0.0, -math.cos(tilt), -math.sin(tilt)])
    put_back = seen.at_one_instant(twist.angular * readout * up)
    assert np.abs(seen.current[here] - expected.current[there]).max() > 0.01
    np.testing.assert_allclose(put_back.current[here], expected.current[there], atol=1e-6)


def test_ahead_and_up_are_seen_as_the_mount_has_them() -> None:
    tilt, roll, yaw = 0.2, 0.1, -0.3
    axes = CameraMount(tilt=tilt, roll=roll, yaw=yaw).R_world_camera(DESIRED_POSE)
    ahead, up = axes.T @ [0.0, 1.0, 0.0], axes.T @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(base_axes(tilt, roll, yaw), [ahead, up], atol=1e-12)


@pytest.mark.parametrize(
    ('true', 'told'),
    [(0.01, 0.0), (0.02, 0.0), (0.033, 0.0), (0.01, 0.033), (0.0, 0.0), (0.02, 0.02)],
)
def test_the_first_turn_shows_a_readout_that_is_not_as_configured(true, told) -> None:
    shutter = driven(true, told)
    value, deviation = shutter.estimate
    assert value == pytest.approx(true, abs=0.003)
    assert deviation < 0.004
    assert shutter.readout(told) == (told if true == told else value)


def test_a_base_that_turns_to_and_fro_from_image_to_image_shows_in_the_rows() -> None:
    readout, rates = 0.033, [0.3 * (-1) ** number for number in range(20)]
    world = PointWorld(PointSettings(), SimulatedRig(CAMERA), seed=0, shutter=Shutter(readout))
    shutter, axes = RollingShutter(), base_axes(0.0, 0.0, 0.0)
    for number, rate in enumerate(rates):
        # In between it turns there and back, so that the middle rows are alike.
        motion = CameraMotion(Twist(0.0, rate))
        pose = integrate(DESIRED_POSE, motion.twist, -0.5 * readout)
        seen = observe(world.observe(pose, number, motion), CAMERA, number * 66_666_667)
        shutter = shutter.updated(seen, axes, readout)
    assert abs(shutter.rate.mean) < 0.05
    assert shutter.rate.now == pytest.approx(rates[-1], abs=0.08)


@pytest.mark.parametrize('points', [1, 2, 3])
def test_features_at_a_few_points_tell_nothing_of_the_readout(points: int) -> None:
    shutter, axes = RollingShutter(), base_axes(0.0, 0.0, 0.0)
    ids = np.arange(20)
    for number in range(12):
        angle = 0.001 * number**2  # from rest into a turn
        angles = angle + 0.1 * (ids % points)
        rays = np.stack([np.sin(angles), 0.02 * (ids % points), np.cos(angles)], axis=1)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        seen = Observation(
            number * 50_000_000, rays, rays, CAMERA.focal, ids=ids, rows=0.1 * rays[:, 1]
        )
        shutter = shutter.updated(seen, axes, 0.02)
        assert shutter.readout(0.02) == 0.02
    assert math.isfinite(shutter.rate.now)


FOCAL, NOISE_PX, COUNT = 769.0, 0.2, 120
STARTS = [(1.0, -3.5, 8.0), (-1.2, -2.5, -12.0)]


def said(current: np.ndarray, desired: np.ndarray, scale: float) -> str:
    """Return what is said of noisy rays through a lens of ``scale`` times its focal length."""
    rng = np.random.default_rng(0)
    seen = (
        through_lens(blurred(rays, NOISE_PX / FOCAL, rng), 1.0 / scale)
        for rays in (current, desired)
    )
    return contradicted_by_pair(Observation(0, *seen, scale * FOCAL), ServoSettings())[0]


@pytest.mark.parametrize('start', STARTS)
@pytest.mark.parametrize('scale', [0.5, 1.0, 2.0])
def test_a_wrong_focal_length_of_a_pair_is_said_with_the_right_one(start, scale) -> None:
    doubt = said(*matches(Pose.from_start(*start), count=COUNT), scale)
    if scale == 1.0:
        assert doubt == ''
        return
    assert doubt.startswith(
        f'the matches contradict the camera: a focal length of {scale * 769:.0f}'
    )
    assert float(doubt.split('they say ')[1].split()[0]) == pytest.approx(FOCAL, rel=0.1)


@pytest.mark.parametrize('scale', [0.5, 1.0, 2.0])
@pytest.mark.parametrize('start', [(0.9, -1.5, -6.0), (-1.1, -1.2, 9.0)])
def test_one_wall_tells_nothing(start: tuple[float, float, float], scale: float) -> None:
    tilt, _ = cv2.Rodrigues(np.array([0.1, 0.0, 0.0]))
    wall = np.random.default_rng(1).uniform([-2.0, -0.8, 3.0], [2.0, 0.8, 3.0], (300, 3))
    current = seen_from(Pose.from_start(*start), wall)
    shown = np.abs(current[:, 0]) < 0.83 * current[:, 2]
    views = (normalised(points[shown]) @ tilt for points in (current, wall))
    assert said(*views, scale) == ''


@pytest.mark.parametrize(
    ('wide', 'focal_deviation', 'count'),
    [(True, 0.0, COUNT), (False, 0.3, COUNT), *((False, 0.0, few) for few in (0, 1, 5, 11))],
)
def test_what_is_wide_not_calibrated_or_few_tells_nothing(wide, focal_deviation, count) -> None:
    current, desired = (rays[:count] for rays in matches(Pose.from_start(*STARTS[0]), count=COUNT))
    view = Observation(0, current, desired, FOCAL, wide=wide)
    assert contradicted_by_pair(view, ServoSettings(focal_deviation=focal_deviation)) == ('', None)
