"""Mutual nearest ones, as if all distances were looked at together."""

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import IntArray
from visual_servo_epipolar.core.tracking.matchers import nearest
from visual_servo_epipolar.core.tracking.matchers.nearest import mutual_nearest, RATIO


def by_all_distances(desired: np.ndarray, current: np.ndarray) -> IntArray:
    squared = ((desired[:, None] - current) ** 2).sum(axis=2)
    pairs = []
    for row, distances in enumerate(squared):
        column, second = int(distances.argmin()), float(np.partition(distances, 1)[1])
        near = distances[column] < np.float32(RATIO**2) * second
        if near and int(squared[:, column].argmin()) == row:
            pairs.append((row, column))
    return np.array(pairs, np.int64).reshape(-1, 2)


@given(
    counts=st.tuples(st.integers(2, 40), st.integers(2, 40)),
    block=st.integers(1, 41),
    most=st.sampled_from([3, 255]),
    seed=st.integers(0, 2**31),
)
def test_blocks_give_the_pairs_of_all_distances(
    counts: tuple[int, int], block: int, most: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)  # few values make ties
    desired, current = (
        rng.integers(0, most + 1, (count, 128 if most > 3 else 4)).astype(np.float32)
        for count in counts
    )
    current[: min(counts) // 2] = desired[: min(counts) // 2]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nearest, 'BLOCK', block)
        pairs = mutual_nearest(desired, current)
    np.testing.assert_array_equal(pairs, by_all_distances(desired, current))


@pytest.mark.parametrize('counts', [(0, 5), (5, 0), (1, 5), (5, 1)])
def test_without_a_second_nearest_nothing_is_near(counts: tuple[int, int]) -> None:
    desired, current = (np.ones((count, 128), np.float32) for count in counts)
    assert mutual_nearest(desired, current).shape == (0, 2)
