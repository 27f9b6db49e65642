"""The bundle: its derivatives are those of its residuals, and exact measurements are met."""

from dataclasses import replace

from docking_drives import Drive
import numpy as np
import pytest

from visual_servo_epipolar.core.docking import bundle, path_terms
from visual_servo_epipolar.core.docking.projection import nearness_of, projected, slopes
from visual_servo_epipolar.core.docking.settings import DockPoseSettings
from visual_servo_epipolar.core.docking.sighting import problem_of
from visual_servo_epipolar.core.docking.unknowns import Unknowns
from visual_servo_epipolar.core.geometry.motion import HALF_PI
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount
from visual_servo_epipolar.simulation.point_world import PointSettings

MOUNT = CameraMount(tilt=0.1, roll=0.05)
SETTINGS = DockPoseSettings(camera_tilt=0.1, camera_roll=0.05)
STEP = 1e-6


@pytest.fixture(scope='module')
def exact():
    """Return a problem without noise, and its true unknowns."""
    drive = Drive(
        start=(0.3, -2.0, 4.0),
        angular=0.2,
        mount=MOUNT,
        points=PointSettings(noise=0.0),
        odometry_noise=0.0,
    )
    *_, (search, _) = searches = list(drive.searched(SETTINGS, 8))
    problem = problem_of(search.keys, 0.2, SETTINGS)
    true = {s.last.place.stamp_ns: (p.y, -p.x, p.theta - HALF_PI, 0, 0) for s, p in searches}
    views = np.array([true[key.place.stamp_ns] for key in search.keys])
    shared, _ = SETTINGS.shared
    nearness = nearness_of(problem, views, shared)
    return problem, Unknowns(views, shared, np.zeros((len(nearness), 2)), nearness)


def test_the_truth_leaves_no_residuals(exact) -> None:
    assert bundle.cost(*exact) == pytest.approx(0.0, abs=1e-9)


def test_it_finds_the_truth_from_far_off(exact) -> None:
    problem, true = exact
    wrong = true.views * [1.3, 1.3, 1.0, 1.0, 1.0] + [0.0, 0.05, 0.01, 0.0, 0.0]
    start = replace(true, views=wrong, nearness=nearness_of(problem, wrong, true.shared))
    solution = bundle.solved(problem, start, 40)
    # It ends where a step gains no more than a fiftieth of one square.
    assert solution.unknowns.views[:, :3] == pytest.approx(true.views[:, :3], abs=5e-3)
    assert solution.noise_ratio < 0.05


def test_derivatives_are_those_of_the_residuals(exact) -> None:
    problem, at = exact
    here = projected(problem, at)
    told = slopes(problem, at, here)
    count = len(at.nearness)

    def measured(other):
        change = projected(problem, other).residuals - here.residuals
        return change / STEP * problem.seen[..., None]

    def close(column, other):
        expected = column * problem.seen[..., None]
        assert measured(other) == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())

    for j in range(5):
        close(told.by_view[..., j], replace(at, views=at.views + STEP * np.eye(5)[j]))
    for j in range(2):
        close(told.by_attitude[..., j], replace(at, shared=at.shared + STEP * np.eye(6)[j]))
        offsets = np.zeros((count, 2))
        offsets[:, j] = STEP
        close(told.by_feature[..., j], replace(at, offsets=offsets))
    close(told.by_feature[..., 2], replace(at, nearness=at.nearness + STEP))


def test_derivatives_of_the_path_are_those_of_its_residuals(exact) -> None:
    problem, at = exact
    before, told = path_terms.residuals(problem, at), path_terms.slopes(problem, at)
    whole = np.concatenate([at.views.ravel(), at.shared])
    for j in range(len(whole)):
        moved = whole + STEP * np.eye(len(whole))[j]
        other = replace(at, views=moved[:-6].reshape(-1, 5), shared=moved[-6:])
        change = (path_terms.residuals(problem, other) - before) / STEP
        assert change == pytest.approx(told[:, j], abs=1e-3 * max(np.abs(change).max(), 1.0))
