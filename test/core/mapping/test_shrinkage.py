"""Shrinkage: what keyframes say is withdrawn where views near the photograph do not see it."""

from dataclasses import replace

from map_study import (
    map_after_drive,
    StudySettings,
    StudyTrial,
    trial,
)
import numpy as np
import pytest

from visual_servo_epipolar.core.mapping.keyframe_map import KeyframeMap
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.core.mapping.resection import (
    CHANCE,
    NOTHING,
    Shrinkage,
    shrinkage_of,
)

NEAR = [[0.002, -0.01 + 0.0004 * k, 0.001] for k in range(25)]  # right, ahead [m], heading [rad]
SHIFT_PX, NOISE_PX = 0.2, 0.03  # of a feature, from afar in all views and in each view anew


def drive_to(settings: StudySettings, seed: int) -> StudyTrial:
    """Return a drive that ends with many views near the goal."""
    usual = trial(settings, seed)
    return trial(settings, seed, np.vstack([usual.views[:-1, :3], NEAR]))


def seen_otherwise_from_afar(seed: int) -> StudyTrial:
    """Return a drive with features beside their places in all views but those near the goal."""
    settings = StudySettings(noise=NOISE_PX, wrong=0.0)
    drive = drive_to(settings, seed)
    shift = SHIFT_PX * np.random.default_rng(seed).normal(size=drive.pixels.shape[1:])
    pixels = drive.pixels.copy()
    pixels[1 : -len(NEAR)] += shift
    told = replace(settings, noise=SHIFT_PX)
    return replace(drive, settings=told, pixels=pixels)


def at_the_goal(drive: StudyTrial) -> tuple[KeyframeMap, list[MapLocalization]]:
    """Return the memory at the end, and what it said of the views near the goal."""
    first = len(drive.views) - len(NEAR)
    memory, said = map_after_drive(replace(drive, views=drive.views[: first + 1])), []
    for k in range(first, len(drive.views)):
        observations = drive.observations(k)
        # Of all features the corrections look like no motion; of those in view by then they do.
        observations = observations.take(observations.ids % 3 == 0)
        memory, one = memory.after(observations, drive.motion(k))
        said.append(one)
    return memory, said


@pytest.mark.parametrize('seed', [1, 2, 3, 4])
def test_noise_withdraws_nothing(seed) -> None:
    memory, _ = at_the_goal(drive_to(StudySettings(), seed))
    assert 0.0 <= memory.shrinkage.share < CHANCE
    assert memory.shrinkage.withdrawn == 0.0


def test_what_is_seen_otherwise_from_afar_is_withdrawn_near_the_photograph() -> None:
    errors = []
    for seed in range(1, 5):
        drive = seen_otherwise_from_afar(seed)
        memory, said = at_the_goal(drive)
        assert memory.shrinkage.withdrawn > 0.9
        errors.append(np.mean([one.pose[0] for one in said[-10:]]) - drive.views[-1, 0])
    # Who believes the views from afar ends 1.1 mm aside.
    assert np.sqrt(np.mean(np.square(errors))) < 0.5e-3


def test_far_from_the_goal_nothing_is_known_of_it() -> None:
    drive = seen_otherwise_from_afar(1)
    memory, _ = at_the_goal(drive)
    assert memory.shrinkage.share > CHANCE
    afar, _ = memory.after(drive.observations(0), drive.motion(0))
    assert afar.shrinkage.withdrawn == NOTHING.withdrawn == 0.0


@pytest.mark.parametrize(
    ('share', 'withdrawn'), [(0.0, 0.0), (CHANCE, 0.0), (0.5, 1.0), (1.0, 1.0)]
)
def test_small_shares_are_chance_and_large_ones_the_whole(share, withdrawn) -> None:
    assert Shrinkage(share).withdrawn == pytest.approx(withdrawn)


def test_it_stays_within_its_range_and_fades() -> None:
    beyond = shrinkage_of(1.3, 0.0)
    assert beyond.share == 1.0
    assert beyond.variance > 0.0
    assert beyond.before(0.1, 5.0).variance > beyond.variance
