"""Essential matrices from five matches each: of any attitude, from rays in any direction."""

from collections.abc import Callable
import contextlib

import numpy as np
import pytest

from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.estimators.base import Attitude
from visual_servo_epipolar.core.estimators.machinery.hypotheses import Rays, rays_of
from visual_servo_epipolar.core.estimators.machinery.search.five_point import (
    essential_matrices,
    samples,
)
from visual_servo_epipolar.core.estimators.machinery.search.general_hypotheses import (
    general_start_parameters,
)
from visual_servo_epipolar.core.geometry.epipolar import cross_matrix
from visual_servo_epipolar.core.geometry.rays import normalised

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
    for sample in samples(rays.matches, SAMPLES):
        found = essential_matrices(rays, sample[None])
        assert 1 <= len(found) <= 10
        assert distances(found, essential).min() < 1e-6


@pytest.mark.parametrize('seed', range(5))
def test_solutions_are_essential_matrices_of_unit_norm(seed: int) -> None:
    rays, _ = rays_of_views(seed)
    found = essential_matrices(rays, samples(rays.matches, SAMPLES))
    singular = np.linalg.svd(found, compute_uv=False)
    np.testing.assert_allclose(np.linalg.norm(found, axis=(1, 2)), 1.0, rtol=1e-12)
    expected = np.tile(np.sqrt([0.5, 0.5, 0.0]), (len(found), 1))
    np.testing.assert_allclose(singular, expected, atol=1e-6)


def test_solutions_fit_the_five_matches_of_their_sample() -> None:
    rays, _ = rays_of_views(0)
    current = np.stack([rays.x_a, rays.y_a, rays.z_a], axis=-1)
    desired = np.stack([rays.x_d, rays.y_d, rays.z_d], axis=-1)
    for sample in samples(rays.matches, SAMPLES):
        found = essential_matrices(rays, sample[None])
        residual = np.einsum('ni,kij,nj->kn', desired[sample], found, current[sample])
        np.testing.assert_allclose(residual, 0.0, atol=1e-12)


def test_samples_side_by_side_have_the_solutions_of_each_alone() -> None:
    rays, _ = rays_of_views(1)
    chosen = samples(rays.matches, SAMPLES)
    alone = np.concatenate([essential_matrices(rays, sample[None]) for sample in chosen])
    together = essential_matrices(rays, chosen)
    assert len(together) == len(alone)
    np.testing.assert_allclose(together, alone, atol=1e-6)


@pytest.mark.parametrize('count', [5, 6, 26, 400])
def test_samples_are_the_same_each_time_and_have_no_match_twice(count: int) -> None:
    chosen = samples(count, 160)
    samples.cache_clear()
    np.testing.assert_array_equal(samples(count, 160), chosen)
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
def test_coinciding_matches_raise_nothing_but_that_they_are_degenerate(
    kind: str, seed: int
) -> None:
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
    assert essential_matrices(rays, samples(8, 20)).shape == (0, 3, 3)
    with pytest.raises(DegenerateGeometryError):
        general_start_parameters(rays, Attitude())
