"""Closed loops with rigs, mounts and lenses of every kind."""

from dataclasses import replace
from functools import cache
import math
from pathlib import Path
from typing import Any

from durations import few_of
import numpy as np
import pytest

from visual_servo_epipolar.commands.arguments import scenario_path
from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.geometry.rays import rotation_level_camera
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.stamps import period_ns
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.closed_loop import Loop, verdict, View
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.rigs import SimulatedRig
from visual_servo_epipolar.simulation.scenario import from_document, load, Scenario
from visual_servo_epipolar.simulation.sensor import CameraMotion, STILL
from visual_servo_epipolar.simulation.views import points_of, view_of
from visual_servo_epipolar.sweeping.plan import result_of

RIGS = Path(__file__).parents[2] / 'config/rigs'
SEED = 3


@pytest.mark.parametrize(
    ('rig', 'start', 'falls'),
    [('panorama_small', (0.8, 0.4, -150.0), 40), ('pan', (0.6, -0.8, 80.0), 30)],
)
def test_a_rate_that_falls_from_thirty_to_four_is_no_harm(rig, start, falls) -> None:
    scenario = load(None, RIGS / f'{rig}.yaml').seeded(SEED)
    scenario = replace(scenario, camera=replace(scenario.camera, frame_rate=30.0))
    view = view_of(scenario, 'features', SEED)
    loop = Loop(scenario.loop(start, SEED), view, scenario.camera.nominal_camera)
    rng = np.random.default_rng(SEED)

    def fall(sample: Sample) -> None:
        if loop.driven.frame > falls:
            loop.driven._period_ns = period_ns(rng.uniform(2.0, 5.0))

    result = verdict(loop.run(watch=fall), scenario.camera.rig())
    assert result['outcome'] == 'arrived', result['reason']
    assert result['position_error_m'] < 0.003 and result['max_distance_ratio'] < 1.1


def test_a_jpeg_is_nearly_the_image_and_the_same_each_time() -> None:
    settings = CameraSettings(width=160, height=120, focal_length=96.0, noise=0.0)
    plain = CameraSimulator(settings).photograph()
    first, again = (CameraSimulator(replace(settings, jpeg=50)).photograph() for _ in range(2))
    np.testing.assert_array_equal(first, again)
    difference = np.abs(first.astype(int) - plain)
    assert 0 < difference.max() and difference.mean() < 4.0


# In `front`; the last one takes long where the mount is not told.
STARTS = [(1.0, -3.0, 0.0), (-1.2, -4.0, -10.0), (-0.8, -3.5, 8.0), (0.3, -2.2, 0.0)]
SEEDS = [0, 1, 3, 2]
ASIDE = {'mount_yaw': math.radians(5.0), 'mount_forward': 0.2, 'mount_left': 0.1}
TOLD = {
    'camera_yaw': ASIDE['mount_yaw'],
    'camera_forward': ASIDE['mount_forward'],
    'camera_left': ASIDE['mount_left'],
    'camera_yaw_deviation': 0.005,
    'camera_forward_deviation': 0.01,
    'camera_left_deviation': 0.01,
}


@pytest.mark.parametrize(
    ('mount', 'servo', 'count'),
    [
        ({'tilt': math.radians(15.0), 'roll': math.radians(8.0)}, {}, 1),
        pytest.param({'tilt': math.radians(-25.0)}, {}, 4, marks=pytest.mark.long),
        (ASIDE, {}, 1),
        pytest.param(ASIDE, TOLD, 4, marks=pytest.mark.long),
    ],
    ids=['down and rolled', 'up', 'aside and not told', 'aside and told'],
)
def test_a_camera_mounted_otherwise_arrives_and_never_leads_away(mount, servo, count) -> None:
    nominal = Scenario()
    scenario = replace(nominal, camera=replace(nominal.camera, **mount)).with_servo(servo)
    for start, seed in list(zip(STARTS, SEEDS, strict=True))[:count]:
        result = result_of(scenario.seeded(seed), start, seed, 'features')
        assert result['outcome'] == 'arrived', result
        assert result['position_error_m'] < 0.006, result
        assert result['max_distance_ratio'] <= 1.25, result
        assert result['wrong_geometry_s'] < 1.0, result
        # What is told is not found out again: neither an attempt nor a detour is lost to it.
        assert result['attempts'] == 1 or not servo, result


class RemountedView:
    """What a ``camera`` sees that leans by ``tilt`` and ``roll`` since the photograph [deg]."""

    def __init__(self, view: View, camera: CameraModel, tilt: float, roll: float) -> None:
        self._view, self._camera = view, camera
        self._lean = rotation_level_camera(math.radians(tilt), math.radians(roll))

    def observe(self, pose: Pose, frame: int, motion: CameraMotion = STILL) -> Features:
        seen = self._view.observe(pose, frame, motion)
        rays = self._camera.rays(seen.current) @ self._lean
        return replace(seen, current=self._camera.pixels(rays))


def remounted(tilt: float, roll: float) -> dict[str, Any]:
    """Return the verdict on a run whose camera has leant by these angles since the photograph."""
    scenario = Scenario().seeded(1)
    camera = scenario.camera.nominal_camera
    view = RemountedView(points_of(scenario, 1), camera, tilt, roll)
    log = Loop(scenario.loop((0.25, -2.5, 14.8), 1), view, camera).run()
    return verdict(log, scenario.camera.rig())


@pytest.mark.parametrize('law', few_of(['smooth', 'full']))
def test_bumps_of_a_degree_at_start_and_photograph_do_not_hold_the_robot(law: str) -> None:
    rough = load(scenario_path('rough')).with_servo({'law': law})
    seed = 792687567  # the camera leans by 2.3 deg between the views there
    result = result_of(rough.seeded(seed), (-0.75, -3.86, 4.4), seed, 'features')
    assert result['outcome'] == 'arrived', result
    assert result['position_error_m'] < 0.01, result
    assert abs(result['heading_error_deg']) < 0.5, result


@pytest.mark.parametrize(('tilt', 'roll'), few_of([(2.0, 0.0), (0.0, 2.0), (3.0, 0.0)]))
def test_a_camera_that_leans_as_a_floor_does_misleads_nothing(tilt: float, roll: float) -> None:
    result = remounted(tilt, roll)
    assert result['outcome'] == 'arrived', result
    assert result['position_error_m'] < 0.002, result
    assert abs(result['heading_error_deg']) < 0.1, result


def test_a_camera_that_was_remounted_since_the_photograph_is_noticed() -> None:
    result = remounted(0.0, 4.0)
    assert 'the camera tilted by 4.0 deg between the views' in result['reason'], result


RUNS = 2
WIDE = {'principal_u': 639.5, 'principal_v': 511.5, 'distortion_model': 'equidistant'}
LENSES: dict[str, dict[str, Any]] = {
    'pinhole': {},
    'plumb_bob': {'distortion': [-0.25, 0.08, 1e-3, -5e-4, 0.0]},
    'rational': {
        'distortion_model': 'rational_polynomial',
        'distortion': [0.4, 0.1, 5e-4, -3e-4, 0.01, 0.7, 0.2, 0.02],
    },
    'fisheye of 80 deg': {'distortion_model': 'equidistant', 'focal_length': 917.0},
    'fisheye of 180 deg': {'focal_length': 1280.0 / math.pi, **WIDE},
    'fisheye of 185 deg, calibrated': {
        'focal_length': 1280.0 / math.radians(187.0),
        'distortion': [-0.01, 0.003, -0.001, 0.0001],
        **WIDE,
    },
}
BEHIND = Equidistant(1280, 1024, 1280.0 / math.radians(185.0), 396.0, 639.5, 511.5)


@cache
def results(lens: str) -> list[dict[str, Any]]:
    """Return the results of a few runs from the region `front` through a lens."""
    scenario = from_document({'camera': LENSES[lens]}, 'test')
    seeded = [scenario.seeded(seed) for seed in range(RUNS)]
    starts = [start_in('front', 0, i, it, source='features') for i, it in enumerate(seeded)]
    return [
        result_of(it, start, seed, 'features')
        for seed, (it, start) in enumerate(zip(seeded, starts, strict=True))
    ]


@pytest.mark.parametrize('lens', few_of([*LENSES], keep=(5,)))
def test_a_robot_arrives_through_every_lens(lens: str) -> None:
    runs = results(lens)
    assert [run['outcome'] for run in runs] == ['arrived'] * RUNS
    # 0.2 px of noise: 1 mm is typical, and a lens must not add half a millimetre to it.
    errors, ideal = (
        np.median([run['position_error_m'] for run in each]) for each in (runs, results('pinhole'))
    )
    assert errors < ideal + 0.5e-3
    assert max(run['position_error_m'] for run in runs) < 4e-3
    assert max(abs(run['heading_error_deg']) for run in runs) < 0.15
    assert max(run['max_distance_ratio'] for run in runs) < 1.01


def test_points_fill_the_image_of_a_lens_that_sees_behind() -> None:
    world = PointWorld(PointSettings(noise=0.0), SimulatedRig(BEHIND), seed=0)
    pixels, visible = world.project(DESIRED_POSE)
    np.testing.assert_allclose(pixels, world._desired, atol=1e-9)
    assert visible.all()
    rays = BEHIND.rays(pixels)
    assert (rays[:, 2] < 0.0).any()
    distance = np.linalg.norm(world.points - [0.0, 0.0, 0.6], axis=1)
    assert (distance.min() > 3.0, distance.max() < 8.0) == (True, True)


def test_what_is_farther_behind_than_the_lens_sees_is_not_in_view() -> None:
    # The image is wider than what the lens sees: its corners are dark.
    narrow = Equidistant(1280, 1024, 480.0, 480.0, 639.5, 511.5, (-0.1, 0.0, 0.0, 0.0))
    world = PointWorld(PointSettings(noise=0.0), SimulatedRig(narrow), seed=0)
    assert np.isfinite(world.points).all()
    pixels, visible = world.project(Pose(0.0, 0.0, -math.pi / 2.0))  # it looks the other way
    away = world.points - [0.0, 0.0, 0.6]
    angles = np.arccos(-away[:, 1] / np.linalg.norm(away, axis=1))
    assert (angles[visible] <= narrow.reach).all()
    assert np.isnan(pixels[angles > narrow.reach]).all()
    assert (angles > narrow.reach).sum() > 100


def test_the_zeros_of_one_lens_are_no_distortion_of_another() -> None:
    for name, kind in (('equidistant', 'Equidistant'), ('rational_polynomial', 'Camera')):
        camera = from_document({'camera': {'distortion_model': name}}, 'test').camera.camera
        assert (type(camera).__name__, camera.distortion) == (kind, ())


def test_a_lens_with_too_few_coefficients_is_refused_by_the_scenario() -> None:
    document = {'camera': {'distortion_model': 'equidistant', 'distortion': [0.1, 0.1]}}
    with pytest.raises(Exception, match='must have 4 coefficients, got 2'):
        from_document(document, 'test')
