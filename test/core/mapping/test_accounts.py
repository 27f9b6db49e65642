"""Two accounts of the way: who believes the other has the same memory, of another scale."""

from map_study import StudyTrial, two_views
import numpy as np
import pytest

from visual_servo_epipolar.core.mapping.feature_observations import MapSettings
from visual_servo_epipolar.core.mapping.keyframe_map import KeyframeMap

RATIO = 1.4
SURE = MapSettings(scale_deviation=1e-3)
OTHER = MapSettings(scale_deviation=2e-3)


def remembered(
    drive: StudyTrial, swapped_at: int | None = None, ratio: float = RATIO
) -> KeyframeMap:
    """Return the memory of a drive whose way was ``ratio`` as long by the other account."""
    memory, other = KeyframeMap(drive.mount, SURE), False
    for k in range(14):
        if k == swapped_at:
            memory, other = memory.with_alternative(OTHER), True
        motion = drive.motion(k)
        accounts = (ratio * motion, motion) if other else (motion, ratio * motion)
        told = two_views(drive, k).bearings if memory.geometry is None else ()
        memory, _ = memory.after(
            drive.observations(k), accounts[0], alternative_motion=accounts[1], bearings=told
        )
        memory = memory.update_map()
    return memory


def whole(memory: KeyframeMap) -> float:
    """Return the way from keyframe to keyframe in the geometry [m]."""
    steps = np.diff(memory.geometry.unknowns.views[:, :2], axis=0)
    return float(np.hypot(*steps.T).sum())


def test_the_same_memory_is_as_large_as_the_other_way(drive) -> None:
    before = remembered(drive)
    after = before.with_alternative(OTHER)
    assert whole(after) == pytest.approx(RATIO * whole(before), rel=1e-3)
    assert after.geometry.depth == pytest.approx(RATIO * before.geometry.depth, rel=1e-3)
    assert after.pose[:2] == pytest.approx(RATIO * before.pose[:2], rel=1e-3)
    assert after.pose[2:] == pytest.approx(before.pose[2:])
    assert after.settings is OTHER
    assert after.geometry.evaluation.factors.scale_deviation == pytest.approx(2e-3, rel=20.0)


def test_who_swaps_twice_is_where_he_was(drive) -> None:
    before = remembered(drive)
    again = before.with_alternative(OTHER).with_alternative(SURE)
    assert whole(again) == pytest.approx(whole(before), rel=1e-6)
    assert np.array_equal(again.places, before.places)
    assert np.array_equal(again.window.driven_places, before.window.driven_places)


@pytest.mark.parametrize('at', [0, 1, 9])
def test_who_comes_to_believe_it_has_it_of_the_whole_way(drive, at: int) -> None:
    late = remembered(drive, swapped_at=at)
    assert whole(late) / float(late.window.ways.sum()) == pytest.approx(1.0, rel=0.02)
    depth = remembered(drive).geometry.depth
    assert late.geometry.depth == pytest.approx(RATIO * depth, rel=0.05)


def test_the_view_after_it_is_where_it_is_by_the_other_account(drive) -> None:
    places = []
    for memory in (remembered(drive), remembered(drive).with_alternative(OTHER)):
        _, said = memory.after(drive.observations(14), drive.motion(14))
        assert not said.reason
        places.append(said.pose[:2])
    assert places[1] == pytest.approx(RATIO * places[0], rel=0.02, abs=2e-3)


def test_without_another_account_both_are_the_same(drive) -> None:
    memory = KeyframeMap(drive.mount, SURE)
    for k in range(3):
        memory, _ = memory.after(drive.observations(k), drive.motion(k))
    assert np.array_equal(memory.places[0], memory.places[1])
