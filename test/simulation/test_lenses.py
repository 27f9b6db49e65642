"""Runs through every lens: they end where the ideal pinhole's do, within the noise."""

from functools import cache
import math
from typing import Any

from durations import few_of
import numpy as np
import pytest

from visual_servo_epipolar.core.cameras.equidistant import Equidistant
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.simulation.mounts.mounting import FixedRig
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import from_document
from visual_servo_epipolar.sweeping.plan import result_of

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
    world = PointWorld(PointSettings(noise=0.0), FixedRig(BEHIND), seed=0)
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
    world = PointWorld(PointSettings(noise=0.0), FixedRig(narrow), seed=0)
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
