"""Two lenses: each sees its side from its own centre, in points and in images alike."""

from dataclasses import replace

import numpy as np
import pytest

from visual_servo_epipolar.core.cameras.registry import camera_of_size
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.tracking.canvas import Canvas
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.mounts.camera_settings import two_lens_rig, TwoLensSettings
from visual_servo_epipolar.simulation.mounts.simulated_rig import ONE_LENS
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld, through

SIZE = 320, 160
DUAL = TwoLensSettings(
    width=320,
    height=160,
    focal_length=160 / np.pi,
    principal_u=79.5,
    principal_v=79.5,
    distortion_model='dual_fisheye',
    image_circle=180.0,
    lens_baseline=0.2,
    noise=0.0,
)
STITCHED = replace(DUAL, distortion_model='equirectangular_stitched')
POSE = Pose.from_start(0.4, -0.6, 70.0)


@pytest.mark.parametrize('settings', [DUAL, STITCHED], ids=['dual', 'stitched'])
def test_each_side_is_seen_from_the_centre_of_its_lens(settings) -> None:
    camera, lenses = settings.camera, two_lens_rig(settings).lenses
    points = np.array([[1.0, 0.5, 2.0], [-0.7, 0.2, -3.0]])
    pixels, visible = through(lenses, points, camera)
    rays = points - [[0.0, 0.0, 0.1], [0.0, 0.0, -0.1]]
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    assert visible.all()
    np.testing.assert_allclose(pixels, camera.pixels(rays))


def test_between_both_centres_nothing_is_seen() -> None:
    points = np.array([[2.0, 0.0, 0.05], [2.0, 0.0, 0.15]])
    _, visible = through(two_lens_rig(DUAL).lenses, points, DUAL.camera)
    assert visible.tolist() == [False, True]


def test_the_goal_sees_its_points_where_they_were_drawn() -> None:
    turned = replace(DUAL, lens_rotation=(0.02, 0.01, -0.02))
    world = PointWorld(PointSettings(noise=0.0), two_lens_rig(turned), seed=2)
    pixels, visible = world.project(DESIRED_POSE)
    assert visible.all()
    np.testing.assert_allclose(pixels, world._desired, atol=1e-9)


@pytest.mark.parametrize('settings', [DUAL, STITCHED], ids=['dual', 'stitched'])
def test_an_image_is_of_two_halves_that_two_cameras_in_those_places_take(settings) -> None:
    both = CameraSimulator(settings).capture(POSE, 0)
    shift = {
        side: replace(settings, lens_baseline=0.0, mount_forward=0.1 * side) for side in (1, -1)
    }
    ahead, behind = (CameraSimulator(shift[side]).capture(POSE, 0) for side in (1, -1))
    u, v = np.meshgrid(np.arange(320.0), np.arange(160.0))
    rays = settings.camera.rays(np.column_stack([u.ravel(), v.ravel()])).reshape(160, 320, 3)
    front = rays[..., 2] >= 0.0
    assert np.abs(both.astype(int) - np.where(front, ahead, behind)).max() <= 1
    assert not np.array_equal(ahead, behind)


def test_one_centre_is_one_lens() -> None:
    settings = replace(DUAL, lens_baseline=0.0)
    lenses = two_lens_rig(settings).lenses
    points = np.random.default_rng(1).standard_normal((50, 3)) * 3.0
    both, one = through(lenses, points, DUAL.camera), through(ONE_LENS, points, DUAL.camera)
    np.testing.assert_array_equal(both[1], one[1])
    np.testing.assert_allclose(both[0][both[1]], one[0][one[1]], atol=1e-9)


def test_beside_the_seam_nothing_is_gone_by() -> None:
    camera = camera_of_size('equirectangular', SIZE)
    canvas = Canvas.of(camera, np.radians(10.0))
    bearings = np.radians([0.0, 75.0, 85.0, 95.0, 105.0, -95.0, 180.0])
    rays = np.column_stack([np.sin(bearings), 0.0 * bearings, np.cos(bearings)])
    pixels = camera.pixels(rays) + np.array(canvas.margins)
    assert canvas.shows(pixels).tolist() == [True, True, False, False, True, False, True]
    assert Canvas.of(camera).shows(pixels).all()
