"""Essential matrices of five matches: the truth is among them, and starts of planar motions."""

from collections.abc import Callable
import contextlib
from dataclasses import replace
import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from strategies import angles, floats

from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.epipolar import cross_matrix
from visual_servo_epipolar.core.geometry.motion import HALF_PI
from visual_servo_epipolar.core.geometry.rays import (
    normalised,
    rotation_level_camera,
)
from visual_servo_epipolar.core.twoview.estimator import Attitude
from visual_servo_epipolar.core.twoview.five_point import (
    essential_matrices,
    samples_of_five,
)
from visual_servo_epipolar.core.twoview.hypotheses import Rays, rays_of
from visual_servo_epipolar.core.twoview.search import (
    general_start_parameters,
    planar_parameters,
)
from visual_servo_epipolar.core.twoview.tilted_planar import (
    matrices,
    PHI,
    PSI,
    ROLL,
    ROLL_JUMP,
    TILT,
    TILT_JUMP,
)

NOISE = 1e-3
SAMPLES = 12


def views(seed: int, count: int = 30) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return exact rays all around two cameras turned any way, and E of unit norm."""
    rng = np.random.default_rng((11, seed))
    rotation, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    rotation *= np.linalg.det(rotation)
    baseline = normalised(rng.standard_normal(3))
    points = rng.standard_normal((count, 3)) * 3.0
    essential = cross_matrix(baseline) @ rotation / np.sqrt(2.0)
    return normalised(points), normalised(points @ rotation.T + baseline), essential


def rays_of_views(seed: int) -> tuple[Rays, np.ndarray]:
    current, desired, essential = views(seed)
    return rays_of(current, desired, NOISE), essential


def distances(found: np.ndarray, essential: np.ndarray) -> np.ndarray:
    """Return how far each is from E, whose sign is free."""
    difference = np.abs(found - essential).max(axis=(1, 2))
    return np.minimum(difference, np.abs(found + essential).max(axis=(1, 2)))


@pytest.mark.parametrize('seed', range(20))
def test_every_sample_of_exact_matches_has_the_truth_among_its_solutions(seed: int) -> None:
    rays, essential = rays_of_views(seed)
    assert min(rays.z_a.min(), rays.z_d.min()) < -0.5  # far behind the camera
    for sample in samples_of_five(rays.matches, SAMPLES):
        found = essential_matrices(rays, sample[None])
        assert 1 <= len(found) <= 10
        assert distances(found, essential).min() < 1e-6


@pytest.mark.parametrize('seed', range(5))
def test_solutions_are_essential_matrices_of_unit_norm(seed: int) -> None:
    rays, _ = rays_of_views(seed)
    found = essential_matrices(rays, samples_of_five(rays.matches, SAMPLES))
    singular = np.linalg.svd(found, compute_uv=False)
    np.testing.assert_allclose(np.linalg.norm(found, axis=(1, 2)), 1.0, rtol=1e-12)
    expected = np.tile(np.sqrt([0.5, 0.5, 0.0]), (len(found), 1))
    np.testing.assert_allclose(singular, expected, atol=1e-6)


def test_solutions_fit_the_five_matches_of_their_sample() -> None:
    rays, _ = rays_of_views(0)
    current = np.stack([rays.x_a, rays.y_a, rays.z_a], axis=-1)
    desired = np.stack([rays.x_d, rays.y_d, rays.z_d], axis=-1)
    for sample in samples_of_five(rays.matches, SAMPLES):
        found = essential_matrices(rays, sample[None])
        residual = np.einsum('ni,kij,nj->kn', desired[sample], found, current[sample])
        np.testing.assert_allclose(residual, 0.0, atol=1e-12)


def test_samples_side_by_side_have_the_solutions_of_each_alone() -> None:
    rays, _ = rays_of_views(1)
    chosen = samples_of_five(rays.matches, SAMPLES)
    alone = np.concatenate([essential_matrices(rays, sample[None]) for sample in chosen])
    together = essential_matrices(rays, chosen)
    assert len(together) == len(alone)
    np.testing.assert_allclose(together, alone, atol=1e-6)


@pytest.mark.parametrize('count', [5, 6, 26, 400])
def test_samples_are_the_same_each_time_and_have_no_match_twice(count: int) -> None:
    chosen = samples_of_five(count, 160)
    samples_of_five.cache_clear()
    np.testing.assert_array_equal(samples_of_five(count, 160), chosen)
    assert chosen.shape == (160, 5)
    assert chosen.min() >= 0
    assert chosen.max() < count
    assert all(len(set(sample)) == 5 for sample in chosen.tolist())
    assert not chosen.flags.writeable


COINCIDING: dict[str, Callable[[Rays], Rays]] = {
    'one match': lambda rays: rays.take(np.zeros(30, dtype=int)),
    'two matches': lambda rays: rays.take(np.arange(30) % 2),
    'four matches': lambda rays: rays.take(np.arange(30) % 4),
    'one view': lambda rays: rays._replace(x_d=rays.x_a, y_d=rays.y_a, z_d=rays.z_a),
}


@pytest.mark.parametrize('kind', COINCIDING)
@pytest.mark.parametrize('seed', range(4))
def test_coinciding_matches_raise_nothing_but_that_they_are_degenerate(kind, seed) -> None:
    rays = COINCIDING[kind](rays_of_views(seed)[0])
    # What rounding leaves of such matches may be a hypothesis: nothing that is no number.
    with contextlib.suppress(DegenerateGeometryError):
        starts = general_start_parameters(rays, Attitude())
        assert starts.shape[1] == 6
        assert np.isfinite(starts).all()


@pytest.mark.parametrize('ray', np.eye(3).tolist())
def test_matches_that_all_coincide_give_nothing(ray: list[float]) -> None:
    same = np.tile(ray, (8, 1))
    rays = rays_of(same, same, NOISE)
    assert essential_matrices(rays, samples_of_five(8, 20)).shape == (0, 3, 3)
    with pytest.raises(DegenerateGeometryError):
        general_start_parameters(rays, Attitude())


WIDE = Attitude(tilt_deviation=math.radians(15.0), roll_deviation=math.radians(5.0))
SIGNS = st.sampled_from([-1.0, 1.0])


def planar(psi: float, phi: float, tilt: float, roll: float) -> np.ndarray:
    """Return E, shape (1, 3, 3), of a planar motion without jumps."""
    parameters = np.zeros((1, 6))
    parameters[0, [PSI, PHI, TILT, ROLL]] = psi, phi, tilt, roll
    return matrices(parameters)[:, 0].reshape(1, 3, 3)


def headings() -> st.SearchStrategy[float]:
    """Turns to either side from 12 degrees, of which the vertical is the axis, to 160."""
    return st.builds(lambda size, sign: size * sign, floats(0.2, 2.8), SIGNS)


def tilts() -> st.SearchStrategy[float]:
    return floats(-math.radians(30.0), math.radians(30.0))


def rolls() -> st.SearchStrategy[float]:
    return floats(-math.radians(10.0), math.radians(10.0))


def assert_axes(found: np.ndarray, psi: float, phi: float, tolerance: float) -> None:
    """Compare bearings, of which both may be reversed: a sign of E."""
    turned = np.exp(1j * (found[[PSI, PHI]] - [psi, phi]))
    np.testing.assert_allclose(turned * np.sign(turned[0].real), 1.0, atol=tolerance)


@given(angles(), headings(), tilts(), rolls(), SIGNS)
def test_an_exact_planar_motion_is_recovered(psi, heading, tilt, roll, sign) -> None:
    phi = psi - heading - HALF_PI
    essential = planar(psi, phi, tilt, roll)
    found = planar_parameters(sign * essential, WIDE)[0]
    # The prior pulls by PLANARITY, in units of the turn: 0.01 at 12 degrees, 1e-4 at right angles.
    tolerance = 0.02
    assert found[TILT] == pytest.approx(tilt, abs=tolerance)
    assert found[ROLL] == pytest.approx(roll, abs=tolerance)
    assert_axes(found, psi, phi, tolerance)
    assert found[TILT_JUMP] == found[ROLL_JUMP] == 0.0


@given(angles(), headings(), tilts(), rolls(), SIGNS)
def test_the_rotation_is_never_that_of_the_twin(psi, heading, tilt, roll, sign) -> None:
    essential = planar(psi, psi - heading - HALF_PI, tilt, roll)
    found = planar_parameters(sign * essential, WIDE)[0]
    turn = math.remainder(found[PSI] - found[PHI] - HALF_PI - heading, math.tau)
    # The twin turns by half around the baseline: as far from the truth as two turns can be.
    assert abs(turn) < 0.02


def vertical(tilt: float, roll: float) -> np.ndarray:
    """Return which way is down in camera axes."""
    return rotation_level_camera(tilt, roll)[1]


def closest_vertical(psi: float, tilt: float, roll: float, prior: Attitude) -> np.ndarray:
    """Return what is down by ``prior``, less what a baseline of a level floor excludes."""
    baseline = rotation_level_camera(tilt, roll).T @ [math.cos(psi), 0.0, math.sin(psi)]
    down = vertical(prior.tilt, prior.roll)
    down = down - (down @ baseline) * baseline
    return np.asarray(down / np.linalg.norm(down))


@pytest.mark.parametrize(
    ('way', 'tilt', 'roll'),
    [((HALF_PI, 0.0, math.radians(20.0), 0.0), 20.0, 4.0)]
    + [((0.0, -HALF_PI, 0.0, math.radians(8.0)), 5.0, 8.0)],
    ids=['ahead', 'aside'],
)
@pytest.mark.parametrize('sign', [-1.0, 1.0])
def test_a_translation_tells_one_angle_the_prior_the_other(way, tilt, roll, sign) -> None:
    essential = sign * planar(*way)
    prior = replace(WIDE, tilt=math.radians(5.0), roll=math.radians(4.0))
    found = planar_parameters(essential, prior)[0]
    assert math.degrees(found[TILT]) == pytest.approx(tilt, abs=0.3)
    assert math.degrees(found[ROLL]) == pytest.approx(roll, abs=0.3)


@given(angles(), tilts(), rolls(), SIGNS)
def test_a_pure_translation_leaves_the_rest_to_an_equal_prior(psi, tilt, roll, sign) -> None:
    prior = Attitude(0.1, 0.05, 0.1, 0.1)
    found = planar_parameters(sign * planar(psi, psi - HALF_PI, tilt, roll), prior)[0]
    expected = closest_vertical(psi, tilt, roll, prior)
    np.testing.assert_allclose(vertical(found[TILT], found[ROLL]), expected, atol=0.01)


@given(angles(), tilts(), rolls())
def test_a_translation_of_the_right_attitude_is_recovered(psi, tilt, roll) -> None:
    phi = psi - HALF_PI
    found = planar_parameters(planar(psi, phi, tilt, roll), replace(WIDE, tilt=tilt, roll=roll))
    np.testing.assert_allclose(found[0, [TILT, ROLL]], [tilt, roll], atol=1e-6)
    assert_axes(found[0], psi, phi, 1e-6)
