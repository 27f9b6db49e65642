"""What keyframes of the map tell of a camera that looks aside of where it is driven."""

from dataclasses import dataclass, replace
import math

from map_study import map_after_drive, StudySettings, StudyTrial, trial
import numpy as np
import pytest
from servo_states import in_phase, seeing, SETTINGS, sight, TWO_VIEWS

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimate.extrinsics import (
    driven_yaw,
    Extrinsics,
    PLAUSIBLE,
    with_driven_yaw,
    YAW,
)
from visual_servo_epipolar.core.laws.phase import Event, Phase
from visual_servo_epipolar.core.mapping.refinement import Geometry
from visual_servo_epipolar.core.servo.supervisor import classify

KNOWN = SETTINGS.extrinsics
MOST_YAW = math.degrees(PLAUSIBLE * SETTINGS.camera_yaw_deviation)


@dataclass(frozen=True, eq=False, kw_only=True)
class Aside(StudyTrial):
    """Drive of a camera that looks to the left of it by ``yaw`` [rad]."""

    yaw: float

    def motion(self, k: int) -> FloatArray:
        cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
        return np.array([[cosine, -sine], [sine, cosine]]) @ super().motion(k)


def keyframes(degrees: float = 0.0, *, seed: int = 0, noise: float = 0.2) -> Geometry:
    """Return those of a drive by a camera that looks to the left by so much."""
    drive = trial(StudySettings(wrong=0.0, noise=noise), seed)
    geometry = map_after_drive(Aside(**vars(drive), yaw=math.radians(degrees))).geometry
    assert geometry is not None
    return geometry


def believing(degrees: float) -> Extrinsics:
    """Return a belief in a yaw [deg]."""
    mean = KNOWN.mean + [0.0, 0.0, math.radians(degrees), 0.0, 0.0]
    return replace(KNOWN, mean=mean, believed=True)


def learnt(belief: Extrinsics, geometry: Geometry, *, missed: bool = False) -> Extrinsics:
    return with_driven_yaw(belief, geometry, missed=missed)


@pytest.mark.parametrize('degrees', [-3.0, -0.8, 0.8, 1.5])
def test_the_yaw_of_a_camera_that_looks_aside_is_learnt(degrees) -> None:
    """Though nobody knows how far ahead of the axle it sits."""
    told = learnt(KNOWN, keyframes(degrees))
    assert told.believed
    assert math.degrees(told.mount[0]) == pytest.approx(degrees, abs=0.35)


def test_its_deviation_is_honest() -> None:
    found = [driven_yaw(KNOWN, keyframes(seed=seed)) for seed in range(12)]
    ratios = [off * off / variance for off, variance in found]
    assert 0.4 < np.mean(ratios) < 2.0
    assert max(variance for _, variance in found) < math.radians(0.2) ** 2


@pytest.mark.parametrize('shown', [{'degrees': 0.1}, {'degrees': 2.0, 'noise': 1.0}])
def test_what_hardly_matters_or_is_hardly_known_is_left_alone(shown) -> None:
    assert learnt(KNOWN, keyframes(**shown)) is KNOWN


@pytest.mark.parametrize('way', [0.0, math.nan])
def test_where_nobody_knows_the_way_nothing_is_learnt(way) -> None:
    geometry, wrong = keyframes(), believing(2.0)
    window = replace(geometry.window, driven_places=np.full((len(geometry.window), 2), way))
    pushed = replace(geometry, evaluation=replace(geometry.evaluation, window=window))
    assert learnt(wrong, pushed) is wrong


def test_once_two_geometries_have_fitted_it_is_learnt_after_a_miss_alone() -> None:
    doubtful, geometry = replace(KNOWN, ambiguous=True), keyframes(3.0)
    assert learnt(doubtful, geometry) is doubtful
    assert learnt(doubtful, geometry, missed=True).believed


def test_a_mount_that_cannot_be_is_not_learnt() -> None:
    begun = believing(MOST_YAW - 0.5)
    assert learnt(begun, keyframes(MOST_YAW + 2.0)) is begun
    assert learnt(begun, keyframes(MOST_YAW - 2.0)) is not begun


def test_a_wrong_yaw_that_is_believed_is_corrected_and_one_map_counts_once() -> None:
    geometry = keyframes()
    after = learnt(learnt(believing(2.0), geometry), geometry)
    assert abs(math.degrees(after.mount[0])) < 0.3
    again = learnt(after, geometry)
    assert again.mount[0] == pytest.approx(after.mount[0], abs=1e-4)
    assert again.covariance[YAW, YAW] > 0.99 * after.covariance[YAW, YAW]


def test_who_knows_the_offset_needs_no_new_attempt_for_a_yaw() -> None:
    """Two views cannot tell that they are aside: what they drove by was wrong, and they repeat."""
    turned = replace(KNOWN, mean=np.array([0.0, 1.0, 0.05, 0.0, 0.0]), believed=True)
    near = sight(parallax=0.0, difference=0.0, heading_error=0.0)
    state = in_phase(
        Phase.MATCHING_FEATURES,
        extrinsics=turned,
        settled=SETTINGS.arrival_frames,
        settled_parallax=0.0,
    )
    assert classify(seeing(state, measurement=near), TWO_VIEWS) is Event.MISSED
    known = replace(
        near, offset=(0.0, 0.0), offset_deviation=1e-3, heading_deviation=1e-3,
        difference_slope=0.05, difference_deviation=0.0,
    )  # fmt: skip
    assert classify(seeing(state, measurement=known), SETTINGS) is Event.MATCHED
