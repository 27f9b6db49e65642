"""The cloud of points: what a perfect tracker would see of it."""

from dataclasses import replace
import math

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import CAMERA, fundamental_from_pose, poses_behind_the_goal

from visual_servo_epipolar.core.geometry.epipolar import sampson_distance
from visual_servo_epipolar.core.geometry.motion import (
    DESIRED_POSE,
    HALF_PI,
    Pose,
    Twist,
)
from visual_servo_epipolar.core.geometry.rays import normalised
from visual_servo_epipolar.simulation.bases import LEVEL, Nod
from visual_servo_epipolar.simulation.disturbances import Disturbances, DisturbanceSettings
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld
from visual_servo_epipolar.simulation.rendering.renderer import Renderer
from visual_servo_epipolar.simulation.rendering.surfaces import ROOM, Scene, Surface, Texture
from visual_servo_epipolar.simulation.rigs import pitched, SimulatedRig
from visual_servo_epipolar.simulation.scenario import from_document
from visual_servo_epipolar.simulation.sensor import CameraMotion, Shutter
from visual_servo_epipolar.simulation.views import points_of

EXACT = PointSettings(noise=0.0)
TILE = Surface('tile', ROOM, np.zeros(3), *np.eye(3)[:2], Texture(np.zeros((4, 4), np.uint8)))
BEHIND = Pose(1.0, -3.0, HALF_PI)


def world(points: PointSettings = EXACT, *, seed: int = 0) -> PointWorld:
    return PointWorld(points, SimulatedRig(CAMERA), seed=seed)


def test_from_the_goal_everything_is_where_the_photograph_has_it() -> None:
    features = world().observe(DESIRED_POSE, 0)
    assert len(features) == EXACT.max_features
    np.testing.assert_allclose(features.current, features.desired, atol=1e-9)


@settings(max_examples=30)
@given(poses_behind_the_goal())
def test_exact_matches_obey_the_epipolar_constraint_of_the_pose(pose: Pose) -> None:
    features = world().observe(pose, 0)
    fundamental = fundamental_from_pose(CAMERA.matrix, pose)
    # Pixels of 1e3 in double precision.
    np.testing.assert_allclose(
        sampson_distance(fundamental, features.current, features.desired), 0.0, atol=1e-9
    )


@settings(max_examples=30)
@given(poses_behind_the_goal())
def test_only_what_is_in_view_is_seen(pose: Pose) -> None:
    features = world().observe(pose, 0)
    assert CAMERA.contains(features.current).all()
    assert len(set(features.ids.tolist())) == len(features)


def test_nothing_is_seen_behind_the_camera() -> None:
    assert len(world().observe(Pose(0.0, 0.0, -HALF_PI), 0)) == 0


def test_an_id_keeps_its_point() -> None:
    near, far = world().observe(BEHIND, 0), world().observe(Pose(0.5, -1.0, HALF_PI), 7)
    _, in_near, in_far = np.intersect1d(near.ids, far.ids, return_indices=True)
    assert len(in_near) > 8
    np.testing.assert_array_equal(near.desired[in_near], far.desired[in_far])


@pytest.mark.parametrize('noise', [0.2, 1.0])
def test_noise_has_the_deviation_asked_for(noise: float) -> None:
    settings = PointSettings(noise=noise, candidates=4000, max_features=4000)
    exact, visible = world(settings).project(BEHIND)
    features = world(settings).observe(BEHIND, 3)
    error = features.current - exact[features.ids]
    assert visible[features.ids].all()
    # Some thousand coordinates: the deviation is known to 1 %, the mean to 0.02 of it.
    assert error.std() == pytest.approx(noise, rel=0.05)
    assert abs(error.mean()) < 0.08 * noise


def test_seed_and_frame_fix_the_noise_and_that_of_the_photograph_does_not_change() -> None:
    points = PointSettings(noise=1.0)
    noisy, same = world(points, seed=4), world(points, seed=4)
    one, other = noisy.observe(BEHIND, 0), noisy.observe(BEHIND, 1)
    np.testing.assert_array_equal(one.desired, other.desired)
    assert (one.current != other.current).all()
    np.testing.assert_array_equal(same.observe(BEHIND, 1).current, other.current)
    assert not np.array_equal(world(points, seed=5).observe(BEHIND, 1).current, other.current)


def test_points_lie_between_near_and_far() -> None:
    # Seen from the axis at 1 m behind the goal, a point at depth z shrinks by z / (z + 1).
    features = world().observe(Pose(0.0, -1.0, HALF_PI), 0)
    centre = [CAMERA.cx, CAMERA.cy]
    from_centre = [
        np.linalg.norm(it - centre, axis=1) for it in (features.current, features.desired)
    ]
    ratio = from_centre[0] / from_centre[1]
    depth = ratio / (1.0 - ratio)
    assert EXACT.near - 1e-6 <= depth.min()
    assert depth.max() <= EXACT.far + 1e-6
    assert math.isclose(depth.mean(), 5.5, rel_tol=0.15)  # uniform from 3 to 8 m


@settings(max_examples=30)
@given(poses_behind_the_goal(), st.integers(0, 10**6))
def test_points_are_seen_as_a_camera_in_a_room_sees_them(pose: Pose, frame: int) -> None:
    shaken = {
        **{'jitter': 0.01, 'tilt': 0.05, 'roll': -0.03},
        **{'mount_forward': 0.2, 'mount_left': 0.1, 'mount_yaw': 0.1},
    }
    scenario = from_document({'camera': shaken}, 'test').seeded(5)
    cloud, camera = points_of(scenario, 5), scenario.camera
    renderer = Renderer(Scene((TILE,)), camera.rig())
    expected, expected_visible = renderer.project(cloud.points, pose, frame)
    pixels, visible = cloud.project(pose, frame)
    np.testing.assert_array_equal(visible, expected_visible)
    np.testing.assert_allclose(pixels[visible], expected[visible], atol=1e-9)


def test_a_camera_that_turns_shears_the_points_by_readout_and_rate() -> None:
    rolling, still = (
        PointWorld(EXACT, SimulatedRig(CAMERA), seed=0, shutter=Shutter(readout))
        for readout in (0.03, 0.0)
    )
    turning = CameraMotion(Twist(0.0, 1.0))
    sheared, upright = (each.project(DESIRED_POSE, 0, turning)[0] for each in (rolling, still))
    rays, seen = CAMERA.rays(upright), CAMERA.rays(sheared)
    turned = np.arctan2(seen[:, 0], seen[:, 2]) - np.arctan2(rays[:, 0], rays[:, 2])
    np.testing.assert_allclose(turned, 0.03 * sheared[:, 1] / CAMERA.height, atol=1e-5)


@pytest.mark.parametrize(
    ('readout', 'nod'), [(0.0, Nod(0.01, 0.3)), (0.03, Nod(0.01, 0.3)), (0.03, LEVEL)]
)
def test_a_body_that_nods_or_stands_shows_points_as_an_image_has_them(readout, nod) -> None:
    cloud = PointWorld(EXACT, SimulatedRig(CAMERA), seed=0, shutter=Shutter(readout))
    pixels, visible = cloud.project(BEHIND, 3, CameraMotion(nod=nod))
    for point, pixel in zip(cloud.points[visible][:5], pixels[visible][:5], strict=True):
        pitch = nod.pitch + nod.rate * readout * pixel[1] / CAMERA.height
        axes, centre = pitched(SimulatedRig(CAMERA).camera_pose(BEHIND), BEHIND, pitch)
        np.testing.assert_allclose(
            CAMERA.pixels(normalised(((point - centre) @ axes)[None])), pixel[None], atol=1e-2
        )


def test_a_focus_that_breathes_moves_points_about_the_principal_point() -> None:
    breathing = PointWorld(
        EXACT, SimulatedRig(CAMERA), seed=0, shutter=Shutter(0.0, 0.0, 0.01, 40.0)
    )
    centre = [CAMERA.cx, CAMERA.cy]
    expected, pixels = world().project(BEHIND, 10)[0], breathing.project(BEHIND, 10)[0]
    np.testing.assert_allclose(pixels - centre, 1.01 * (expected - centre), atol=1e-9)


def test_a_floor_that_shakes_moves_what_is_seen_from_the_goal() -> None:
    shaken = PointWorld(EXACT, SimulatedRig(CAMERA, jitter=0.002), seed=0)
    shift = [
        (features.current - features.desired).mean(axis=0)
        for features in (shaken.observe(DESIRED_POSE, frame) for frame in range(200))
    ]
    # Tilt moves the image by 769 px a radian and, away from the middle, some more; the deviation
    # of 200 numbers is known to 5 %. Roll moves left and right in opposite directions.
    down = np.array(shift)[:, 1]
    assert down.std() == pytest.approx(0.002 * CAMERA.fy, rel=0.3)
    assert np.array(shift)[:, 0].std() < 0.3 * down.std()


@pytest.mark.parametrize('ratio', [0.0, 0.2, 0.6])
def test_as_many_features_are_mistaken_as_asked_for(ratio: float) -> None:
    mistaken = world(replace(EXACT, outlier_ratio=ratio, max_features=240))
    shares = [wrong(mistaken, frame).mean() for frame in range(0, 440, 11)]
    # 40 frames of 240 features or fewer: the share is known to 0.8 % at worst.
    assert np.mean(shares) == pytest.approx(ratio, abs=0.03)


def wrong(cloud: PointWorld, frame: int) -> np.ndarray:
    """Return which of the features seen in ``frame`` are not where their points are."""
    features = cloud.observe(BEHIND, frame)
    return np.hypot(*(features.current - cloud.project(BEHIND, frame)[0][features.ids]).T) > 1.0


def test_what_is_mistaken_stays_so_for_some_frames() -> None:
    mistaken = world(replace(EXACT, outlier_ratio=0.3))
    first = wrong(mistaken, 22)
    assert all((wrong(mistaken, frame) == first).all() for frame in range(23, 33))
    assert not np.array_equal(mistaken.taken_for(33), mistaken.taken_for(32))


def test_a_mistaken_feature_sits_on_another_point_in_view() -> None:
    mistaken = world(replace(EXACT, outlier_ratio=0.5))
    features, (pixels, visible) = mistaken.observe(BEHIND, 0), mistaken.project(BEHIND, 0)
    distance = np.linalg.norm(features.current[:, None] - pixels[visible], axis=2).min(axis=1)
    np.testing.assert_allclose(distance, 0.0, atol=1e-9)


def test_a_person_who_passes_hides_points_and_gives_them_back() -> None:
    passing = DisturbanceSettings(disturbed_from=5, disturbed_for=10, person=0.9)
    crossing = Disturbances((CAMERA.width, CAMERA.height), passing, 0)
    everything = replace(EXACT, max_features=EXACT.candidates)
    cloud = PointWorld(everything, SimulatedRig(CAMERA), seed=0, disturbances=crossing)
    before, during, after = (cloud.observe(BEHIND, frame) for frame in (4, 10, 15))
    np.testing.assert_array_equal(before.ids, after.ids)
    gone = np.setdiff1d(before.ids, during.ids)
    assert 10 < len(gone) < 0.5 * len(before)
    places = cloud.project(BEHIND, 10)[0]
    assert crossing.hides(places[gone], 10).all()
    assert not crossing.hides(places[during.ids], 10).any()


def test_the_nominal_camera_is_not_the_one_that_sees() -> None:
    believed = {'believed_focal_ratio': 0.5, 'believed_shift_u': 10.0, 'believed_shift_v': -4.0}
    camera = from_document({'camera': believed}, 'test').camera
    true, nominal = camera.camera, camera.nominal_camera
    assert (nominal.fx, nominal.fy) == (0.5 * true.fx, 0.5 * true.fy)
    assert (nominal.cx, nominal.cy) == (true.cx + 10.0, true.cy - 4.0)
    plain, wrongly = (
        points_of(from_document({'camera': item}, 'test'), 0).observe(BEHIND, 3)
        for item in ({}, believed)
    )
    np.testing.assert_array_equal(plain.current, wrongly.current)
    panorama = {'width': 640, 'height': 320, 'distortion_model': 'equirectangular', **believed}
    camera = from_document({'camera': panorama}, 'test').camera
    assert camera.nominal_camera == camera.camera  # the size of its images tells it
