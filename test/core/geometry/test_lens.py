"""What is learnt of a camera matrix that nobody calibrated."""

import math

from hypothesis import given
import numpy as np
import pytest
from strategies import floats

from visual_servo_epipolar.core.geometry.epipolar import rotation_desired_current, sampson_distance
from visual_servo_epipolar.core.geometry.lens import (
    change,
    corrected,
    for_wrong_rays,
    learnt,
    Lens,
    spurious_parallax,
    unknown_lens,
)
from visual_servo_epipolar.core.geometry.rays import (
    image_points,
    normalised,
    tangents,
    unit_rays,
)
from visual_servo_epipolar.core.geometry.rotation import fit_rotation
from visual_servo_epipolar.core.twoview.observation import Observation

RAYS = unit_rays(np.random.default_rng(0).random((2, 20, 2)) - 0.5)
SEEN = Observation(0, *RAYS, 400.0, (-0.6, 0.7))
UNKNOWN = unknown_lens(1.0)


def homogeneous(rays: np.ndarray) -> np.ndarray:
    """Return rays of any shape as vectors with z = 1, as the lens is linear for them."""
    return np.asarray(rays / rays[:, 2:])


TURNS = np.radians([1.0, -4.0])


def covariance(lens: Lens) -> np.ndarray:
    return np.asarray(lens.root @ lens.root.T)


def test_a_calibrated_lens_changes_nothing() -> None:
    assert unknown_lens(0.0).calibrated
    assert SEEN.corrected(Lens()) is SEEN
    assert learnt(Lens(), Lens(0.3, 0.1)) == Lens()


@given(floats(-1.8, 1.0), floats(-0.05, 0.05), floats(-1.8, 1.0), floats(-0.05, 0.05))
def test_two_corrections_are_one(r: float, h: float, ratio: float, shift: float) -> None:
    before, after = Lens(r, h), Lens(ratio, shift)
    once = SEEN.corrected(after)
    twice = SEEN.corrected(before).corrected(change(after, before))
    np.testing.assert_allclose(twice.current, once.current, atol=1e-12)
    np.testing.assert_allclose(twice.desired, once.desired, atol=1e-12)
    assert twice.focal == pytest.approx(once.focal)
    assert twice.edges == pytest.approx(once.edges)


def test_what_is_learnt_is_what_corrects_what_was_corrected() -> None:
    sure = Lens.of(0.2, 0.01, 1e-8 * np.eye(2))
    before = Lens(-0.5, 0.02, 1.0, 0.02, 0.01)
    after = learnt(before, sure)
    twice = SEEN.corrected(before).corrected(sure)
    np.testing.assert_allclose(SEEN.corrected(after).current, twice.current, atol=1e-6)


def test_a_fundamental_matrix_goes_with_the_rays() -> None:
    lens = Lens(-0.7, 0.03)
    fundamental = np.random.default_rng(1).random((3, 3))
    true = SEEN.corrected(lens)
    residuals = [
        np.einsum('ni,ij,nj->n', *(homogeneous(rays), matrix, homogeneous(other)))
        for rays, matrix, other in (
            (true.desired, fundamental, true.current),
            (SEEN.desired, for_wrong_rays(fundamental, lens), SEEN.current),
        )
    ]
    np.testing.assert_allclose(*residuals, atol=1e-12)
    assert np.abs(sampson_distance(fundamental, *RAYS)).max() > 1e-3  # and not by being zero


def joined(lens: Lens, data: np.ndarray, value: np.ndarray) -> Lens:
    """Return what a pair of views finds that alone tells ``value``, with covariance ``data``."""
    left = np.linalg.inv(np.linalg.inv(covariance(lens)) + np.linalg.inv(data))
    return Lens.of(*(left @ np.linalg.inv(data) @ value).tolist(), left)


def test_many_pairs_tell_no_more_than_the_best() -> None:
    lens, data = UNKNOWN, np.diag([0.1, 0.01]) ** 2
    for _ in range(200):
        lens = learnt(lens, joined(lens, data, np.array([-0.7 - lens.log_ratio, 0.0])))
    assert lens.log_ratio == pytest.approx(-0.7, abs=0.01)
    assert lens.ratio_deviation == pytest.approx(0.1, rel=0.01)


def test_pairs_that_tell_little_do_not_move_what_is_known() -> None:
    lens, data = Lens(-0.7, 0.01, 0.02, 0.002), np.diag([0.4, 0.04]) ** 2
    for _ in range(100):
        lens = learnt(lens, joined(lens, data, np.array([1.0, 0.1])))
    # If they were independent, 100 of them would tell more than was known.
    assert lens.log_ratio == pytest.approx(-0.7, abs=0.02)
    assert lens.shift == pytest.approx(0.01, abs=0.002)
    assert lens.ratio_deviation == pytest.approx(0.02)


def test_what_is_known_together_is_not_forgotten() -> None:
    # A pair fixes a mixture of ratio and shift, the next one the ratio.
    tied = np.array([[0.04, 0.002], [0.002, 1.01e-4]])
    lens = learnt(UNKNOWN, joined(UNKNOWN, tied, np.array([-0.5, 0.0])))
    lens = learnt(lens, joined(lens, np.diag([1e-5, 1.0]), np.array([-0.6 - lens.log_ratio, 0.0])))
    assert lens.log_ratio == pytest.approx(-0.6, abs=1e-3)
    # It goes with the ratio by 0.002 / 0.04.
    assert lens.shift == pytest.approx(-0.005, abs=5e-4)


@pytest.mark.parametrize(('ratio', 'shift'), [(1.1, 0.0), (0.9, 0.0), (1.0, 0.02)])
def test_a_wrong_lens_feigns_as_much_parallax_in_a_turn_as_is_said(ratio, shift) -> None:
    rng = np.random.default_rng(2)
    desired = rng.uniform(-1.0, 1.0, (200, 2)) * [0.8, 0.6]
    for turn in TURNS.tolist():
        current = image_points(unit_rays(desired) @ rotation_desired_current(turn))
        wrong = [unit_rays((points - [shift, 0.0]) / ratio)[None] for points in (current, desired)]
        root = np.diag([abs(math.log(ratio)), shift])
        feigned = spurious_parallax(wrong[1], np.array([turn]), root[None])[0]
        parallax = fit_rotation(wrong[0][0], wrong[1][0]).parallax
        # Feigned is two deviations; parallax leaves out the worst 40 % of the matches.
        assert 0.15 < parallax / feigned < 1.0


def test_a_known_lens_feigns_nothing() -> None:
    assert spurious_parallax(RAYS, np.ones(2), np.zeros((2, 2, 2))).tolist() == [0.0, 0.0]


@given(floats(-1.0, 1.0), floats(-0.05, 0.05))
def test_corrected_rays_go_with_corrected_image_points(r: float, h: float) -> None:
    true, _ = corrected(RAYS[0], Lens(r, h))
    np.testing.assert_allclose(np.linalg.norm(true, axis=1), 1.0, atol=1e-15)
    points = math.exp(r) * image_points(RAYS[0]) + [h, 0.0]
    np.testing.assert_allclose(image_points(true), points, atol=1e-12)
    behind, _ = corrected(-RAYS[0], Lens(r, h))
    np.testing.assert_allclose(behind, -true, atol=1e-15)


@given(floats(-1.0, 1.0), floats(-0.05, 0.05))
def test_noise_grows_as_the_root_of_a_solid_angle(r: float, h: float) -> None:
    ray, step = RAYS[0][:1], 1e-6
    right, down = (np.array(axis).T for axis in tangents(*ray.T))
    bundle = normalised(np.vstack([ray, ray + step * right, ray + step * down]))
    true, growth = corrected(bundle, Lens(r, h))
    area = np.linalg.norm(np.cross(true[1] - true[0], true[2] - true[0])) / step**2
    assert growth[0] == pytest.approx(math.sqrt(area), rel=1e-4)
