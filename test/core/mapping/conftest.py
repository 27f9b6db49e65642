"""Windows of views as the study has them: exact, or with noise and wrong matches."""

from collections.abc import Callable

from map_study import (
    map_after_drive,
    StudySettings,
    StudyTrial,
    trial,
)
import numpy as np
import pytest

from visual_servo_epipolar.core.mapping.factors import factors_of
from visual_servo_epipolar.core.mapping.keyframe_map import KeyframeMap
from visual_servo_epipolar.core.mapping.refinement import Evaluation
from visual_servo_epipolar.core.mapping.window import EMPTY, MapSettings, Unknowns


def at_truth(drive: StudyTrial, views: int = 14) -> Evaluation:
    """Return the window of the first views of a drive at its true unknowns."""
    window = EMPTY
    for k in range(views):
        window = window.with_view(drive.observations(k), drive.scale * drive.views[k, :2])
    # Depths along the ray that the photograph shows: without noise, the truth.
    near = 1.0 / np.linalg.norm(drive.features[window.ids], axis=1)
    shared = np.concatenate([drive.attitude, np.zeros(3)])
    unknowns = Unknowns(drive.views[:views], shared, np.zeros((2, len(near))), near)
    return Evaluation(
        window, unknowns, np.ones(len(near), bool), factors_of(drive.mount, window, MapSettings())
    )


@pytest.fixture(scope='session')
def truth_of() -> Callable[[StudyTrial, int], Evaluation]:
    """Return what makes the window of the first views of a drive at its true unknowns."""
    return at_truth


@pytest.fixture(scope='session')
def exact_drive() -> StudyTrial:
    """Return an exact drive on a level floor, though it is taken to be as others are."""
    drive = trial(StudySettings(noise=1e-9, wrong=0.0, scale_error=0.0, jitter=1e-9), 5)
    object.__setattr__(drive, 'settings', StudySettings(wrong=0.0))
    return drive


@pytest.fixture(scope='session')
def exact(exact_drive: StudyTrial) -> Evaluation:
    """Return its window at the truth."""
    return at_truth(exact_drive)


@pytest.fixture(scope='session')
def drive() -> StudyTrial:
    """Return a drive with noise and wrong matches."""
    return trial(StudySettings(), 3)


@pytest.fixture(scope='session')
def memory(drive: StudyTrial) -> KeyframeMap:
    """Return the memory at the end of it."""
    return map_after_drive(drive)
