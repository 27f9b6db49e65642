"""Projection: derivatives are those of residuals, and the sides of a ray are told apart."""

from dataclasses import replace

from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.epipolar import rotation_desired_current
from visual_servo_epipolar.core.geometry.rays import rotation_level_camera
from visual_servo_epipolar.core.mapping.adjustment import projection
from visual_servo_epipolar.core.mapping.adjustment.window import Unknowns
from visual_servo_epipolar.core.mapping.feature_observations import tangent_basis_of

STEP = 1e-6
ANGLE = st.floats(-0.5, 0.5)
VIEWS = st.tuples(st.floats(-1.0, 1.0), st.floats(-3.0, 0.5), st.floats(-3.0, 3.0), ANGLE, ANGLE)


def seen(photograph, unknowns, view):
    """Return features as DESIGN has it: levelled, moved and turned by the core's own matrices."""
    x, y, heading, tilt, roll = view
    upright = photograph @ rotation_level_camera(*unknowns.shared[:2]).T
    points = upright / unknowns.inverse_depth[:, None] - [x, 0.0, y]
    back = rotation_desired_current(heading) @ rotation_level_camera(tilt, roll)
    return points @ back


@given(view=VIEWS, tilt=ANGLE, roll=ANGLE)
@settings(max_examples=25, deadline=None)
def test_features_lie_where_the_conventions_of_the_core_say(view, tilt, roll) -> None:
    rng = np.random.default_rng(1)
    rays = rng.normal(size=(9, 3))
    photograph = rays / np.linalg.norm(rays, axis=1)[:, None]
    unknowns = Unknowns(
        np.array([view]), np.array([tilt, roll, 0, 0, 0]), np.zeros((2, 9)), rng.uniform(0.1, 1, 9)
    )
    structure = projection.structure_of(
        photograph, tangent_basis_of(photograph, np.ones(9)), unknowns
    )
    points = projection.turns_of(unknowns.views) @ projection.points_of(structure, unknowns.views)
    expected = seen(photograph, unknowns, view) * unknowns.inverse_depth[:, None]
    assert points[0].T == pytest.approx(expected, abs=1e-12)


@given(view=VIEWS, tilt=ANGLE, roll=ANGLE, lens=st.floats(-0.2, 0.2))
@settings(max_examples=25, deadline=None)
def test_derivatives_are_those_of_the_residuals(view, tilt, roll, lens) -> None:
    rng = np.random.default_rng(2)
    rays = rng.normal(size=(9, 3))
    photograph = rays / np.linalg.norm(rays, axis=1)[:, None]
    tangents = tangent_basis_of(
        photograph, np.full(9, 1e3)
    )  # a thousandth of a radian a deviation
    shared, offsets = np.array([tilt, roll, lens, 0.0, 0.0]), rng.normal(size=(2, 9))
    at = Unknowns(np.array([view]), shared, offsets, rng.uniform(0.1, 1.0, 9))
    tangent_basis = tangent_basis_of(photograph, np.full(9, 1.0))[None]

    def residuals(unknowns):
        structure = projection.structure_of(photograph, tangents, unknowns)
        return projection.project(structure, unknowns.views, tangent_basis).residuals

    structure = projection.structure_of(photograph, tangents, at)
    here = projection.project(structure, at.views, tangent_basis)
    told = projection.slopes(structure, at.views, tangent_basis, here)
    axes, pair = np.eye(5), np.eye(2)
    others = [replace(at, views=at.views + STEP * axis) for axis in axes]
    others += [replace(at, offsets=at.offsets + STEP * axis[:, None]) for axis in pair]
    others += [replace(at, inverse_depth=at.inverse_depth + STEP)]
    others += [replace(at, shared=at.shared + STEP * np.eye(5)[j]) for j in range(3)]
    for j, other in enumerate(others):
        expected = (residuals(other) - here.residuals) / STEP
        tolerance = 1e-4 * (1.0 + np.abs(1.0 / here.length).max() ** 2)
        assert told[:, j] == pytest.approx(expected, abs=tolerance)


@pytest.mark.parametrize('lens', [-0.1, 0.05])
def test_a_camera_of_a_longer_lens_sees_features_farther_from_the_centre(lens) -> None:
    """Rays as a wrong focal length has them, of photograph and view: no residual is left."""
    rng = np.random.default_rng(3)
    true = np.column_stack([rng.uniform(-0.5, 0.5, (9, 2)), np.ones(9)])
    near, view = rng.uniform(0.1, 0.5, 9), np.array([0.3, -1.0, 0.1, 0.05, 0.02])
    shared = np.array([0.04, -0.01, lens, 0.0, 0.0])
    points = seen(true, Unknowns(view[None], shared, np.zeros((2, 9)), near), view)
    stretch = np.array([np.exp(lens), np.exp(lens), 1.0])
    photograph, rays = true * stretch, points * stretch
    unknowns = Unknowns(view[None], shared, np.zeros((2, 9)), near)
    structure = projection.structure_of(
        photograph, tangent_basis_of(photograph, np.ones(9)), unknowns
    )
    tangent_basis = tangent_basis_of(rays / np.linalg.norm(rays, axis=1)[:, None], np.ones(9))[
        None
    ]
    found = projection.project(structure, view[None], tangent_basis)
    assert found.residuals == pytest.approx(0.0, abs=1e-12)


def test_what_would_lie_behind_its_ray_is_far_off(exact) -> None:
    window, unknowns = exact.window, exact.unknowns
    ahead = projection.squares_of(exact.projection, window.rays)[window.seen]
    behind = projection.squares_of(exact.projection, -window.rays)[window.seen]
    assert ahead.max() < 1e-6
    assert behind.min() == projection.OPPOSITE
    assert len(unknowns.inverse_depth) == len(window.ids)
