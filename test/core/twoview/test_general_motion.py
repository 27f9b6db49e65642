"""Motions of a camera in the hand: as good as noise allows, and their deviation is honest."""

from dataclasses import replace
from functools import lru_cache
import math
from typing import Any

import cv2
from durations import few_of
import numpy as np
from photograph_pairs import draw_photographs, Kind, KINDS, PhotographPair
import pytest

from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.rays import image_points, normalised, unit_rays
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.twoview.general_motion import (
    general_motion,
    Motions,
    spread_of,
    wrong_depths,
)
from visual_servo_epipolar.core.twoview.hypotheses import Rays, rays_of
from visual_servo_epipolar.core.twoview.inspection import Inspection, judged
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.evaluation.benchmarks.real import angle_errors

PAIRS = 12
SOME = 'facade', 'few', 'phone'  # kinds of pairs that `make test` looks at
SETTINGS = ServoSettings()


def some_of(names: list[str]) -> list[Any]:
    return few_of(names, keep=[k for k, name in enumerate(names) if name in SOME])


def observed(pair: PhotographPair) -> Observation:
    camera = pair.camera
    current, desired = camera.rays(pair.current), camera.rays(pair.desired)
    angles = np.stack([camera.resolution(current), camera.resolution(desired)], axis=1)
    return Observation(0, current, desired, camera.focal, pixel_angles=angles)


def rays_from(pair: PhotographPair) -> Rays:
    view = observed(pair)
    return rays_of(view.current, view.desired, view.resolution)


@lru_cache(maxsize=16)
def drawn(name: str) -> list[PhotographPair]:
    return [draw_photographs(KINDS[name], (7, k)) for k in range(PAIRS)]


@lru_cache(maxsize=16)
def inspected(name: str) -> list[tuple[Inspection, float]]:
    """Return what is told of each pair, and the larger error of its bearings [deg]."""
    answers = []
    for pair in drawn(name):
        found, _ = judged(observed(pair), SETTINGS)
        told = np.array([found.bearing_current, found.bearing_desired, found.rotation])
        answers.append((found, angle_errors(told, pair.truth(ground=found.ground))[:2].max()))
    return answers


def test_a_hand_held_pair_is_seen_as_well_as_noise_allows() -> None:
    errors = []
    for pair in drawn('hand') + drawn('facade'):
        found = general_motion(rays_from(pair)).motions.bearings[0]
        errors.append(angle_errors(found, pair.truth(ground=False))[:2].max())
    assert np.median(errors) < 0.45  # 0.3 deg, with MAGSAC 0.6


@pytest.mark.parametrize('name', some_of(sorted(KINDS)))
def test_nothing_wrong_is_trusted(name: str) -> None:
    wrong = [error for found, error in inspected(name) if found.trusted and error > 3.0]
    assert not wrong


@pytest.mark.parametrize('name', some_of(['car', 'level', 'hand', 'phone', 'leaning', 'facade']))
def test_pairs_of_many_matches_are_trusted(name: str) -> None:
    assert sum(found.trusted for found, _ in inspected(name)) >= 0.8 * PAIRS


@pytest.mark.parametrize(
    'names', [SOME, pytest.param(tuple(KINDS), marks=pytest.mark.long)], ids=['some', 'all']
)
def test_errors_are_as_large_as_the_deviation_says(names: tuple[str, ...]) -> None:
    normalised = [
        error / math.degrees(found.deviation)
        for name in names
        for found, error in inspected(name)
        if found.trusted
    ]
    assert 0.5 < np.median(normalised) < 1.3  # 0.7: of the larger of two errors
    assert np.percentile(normalised, 95) < 3.0


@pytest.mark.parametrize(
    ('name', 'planar'), few_of([('level', True), ('car', True), ('phone', False)], keep=(1, 2))
)
def test_the_simplest_motion_that_explains_the_matches_is_told(name: str, planar: bool) -> None:
    found = [found.planar for found, _ in inspected(name)]
    assert np.mean(found) > 0.85 if planar else not any(found)


@pytest.mark.parametrize('name', some_of(['few', 'near', 'aside']))
def test_a_heading_is_told_only_where_it_is_known(name: str) -> None:
    for pair, (found, _) in zip(drawn(name), inspected(name), strict=True):
        if not math.isnan(found.rotation):
            truth = pair.truth(ground=found.ground)
            off = angle_errors(np.array([found.rotation]), truth[2:])[0]
            assert off < max(4.0 * math.degrees(found.rotation_deviation), 1.0)


def test_matches_on_the_wrong_side_of_their_line_are_dropped() -> None:
    pair = draw_photographs(Kind(baseline=(0.5, 0.6), wrong=(0.0, 0.0)), (1, 0))
    true = Motions(pair.rotation[None], normalised(pair.baseline)[None])
    rays = rays_from(pair)
    assert wrong_depths(true, rays, 1.0).mean() < 0.02
    # Where a feature at infinity would be, and as far again to the other side.
    behind = normalised(2.0 * (rays.current @ pair.rotation.T) - rays.desired)
    moved = rays_of(rays.current, behind, observed(pair).resolution)
    assert wrong_depths(true, moved, 1.0).mean() > 0.9


def test_too_few_matches_tell_nothing() -> None:
    with pytest.raises(DegenerateGeometryError, match='8 matches, got 7'):
        general_motion(rays_from(drawn('hand')[0]).take(slice(7)))


def wall_with_few(wrong: int) -> tuple[Observation, np.ndarray]:
    """
    Return 60 matches of a wall and ``wrong`` ones off it; and the bearings and heading.

    A wall is seen alike from two places, as its homography decomposes in two ways: those off it
    are as from the second.
    """
    rng = np.random.default_rng(3)
    focal, normal, centre = 600.0, np.array([0.35, 0.1, 1.0]) / 3.0, np.array([0.8, 0.0, 0.6])
    _, rotations, ways, normals = cv2.decomposeHomographyMat(
        np.eye(3) - np.outer(centre, normal), np.eye(3)
    )
    rotation, way = next(
        (rotation, way[:, 0])
        for rotation, way, facing in zip(rotations, ways, normals, strict=True)
        if facing[2, 0] > 0.0 and np.abs(rotation - np.eye(3)).max() > 0.1
    )
    wall, off = (unit_rays(rng.uniform(-0.5, 0.5, (count, 2))) for count in (60, wrong))
    wall, off = (rays / (rays @ normal)[:, None] for rays in (wall, off))
    off *= rng.uniform(0.5, 0.8, (wrong, 1))
    desired, current = (
        unit_rays(image_points(points) + rng.normal(0.0, 0.2 / focal, (60 + wrong, 2)))
        for points in (
            np.vstack([wall, off]),
            np.vstack([wall - centre, off @ rotation.T + way]),
        )
    )
    return Observation(0, current, desired, focal), Motions(
        np.eye(3)[None], centre[None]
    ).bearings[0]


@pytest.mark.parametrize('wrong', [0, 6])
def test_a_few_matches_off_a_wall_do_not_decide_from_where_it_is_seen(wrong: int) -> None:
    view, truth = wall_with_few(wrong)
    found, _ = judged(view, SETTINGS)
    told = np.array([found.bearing_current, found.bearing_desired, found.rotation])
    assert not found.trusted or angle_errors(told, truth)[:2].max() < 3.0


def test_errors_that_parts_of_the_image_share_average_out_less() -> None:
    rng, ratios = np.random.default_rng(4), []
    for pair in drawn('level'):
        cell = (pair.desired // (pair.desired.max(axis=0) / [4.0, 2.0] + 1e-6)).astype(int)
        shared = rng.normal(0.0, 1.0, (4, 2, 2))[cell[:, 0], cell[:, 1]]
        alone, together = (
            spread_of(general_motion(rays))[1].noise[:2].max()
            for rays in (
                rays_from(replace(pair, current=pair.current + offset))
                for offset in (rng.permutation(shared), shared)
            )
        )
        ratios.append(together / alone)
    assert np.median(ratios) > 1.3


def test_the_lens_of_a_small_image_is_no_worse() -> None:
    view = observed(drawn('hand')[0])
    large, small, tiny = (
        spread_of(general_motion(rays))[1].camera.max()
        for rays in (
            rays_of(view.current, view.desired, np.full_like(view.resolution, pixel))
            for pixel in (1.0 / 800.0, 1.0 / 400.0, 1.0 / 130.0)
        )
    )
    assert large < 0.8 * small
    assert tiny < 1.2 * small
