"""Index of descriptors: many are searched by neighbourhoods, few one by one, much alike."""

from importlib import import_module

import numpy as np
import pytest

from visual_servo_epipolar.core.arrays import IntArray
from visual_servo_epipolar.core.routes import descriptor_index
from visual_servo_epipolar.core.routes.descriptor_index import DescriptorIndex

PHOTOGRAPHS, EACH = 120, 40
RNG = np.random.default_rng(5)


def of_one_norm(vectors: np.ndarray) -> np.ndarray:
    return (vectors / np.linalg.norm(vectors, axis=1, keepdims=True)).astype(np.float32)


DESCRIPTORS = of_one_norm(RNG.standard_normal((PHOTOGRAPHS * EACH, 32)))
OWNERS = np.repeat(np.arange(PHOTOGRAPHS), EACH)
SHOWN = RNG.integers(0, len(DESCRIPTORS), 200)  # rows that an image shows again, with some noise
IMAGE = of_one_norm(DESCRIPTORS[SHOWN] + 0.05 * RNG.standard_normal((200, 32)))


def found(among: range) -> tuple[IntArray, np.ndarray]:
    index = DescriptorIndex(DESCRIPTORS, OWNERS)
    owners, products = index.nearest(IMAGE, np.array(among))
    best = products.argmax(axis=1)
    return owners[np.arange(len(best)), best], products.max(axis=1)


def test_each_descriptor_is_nearest_to_the_photograph_that_shows_it() -> None:
    owners, products = found(range(PHOTOGRAPHS))
    np.testing.assert_array_equal(owners, OWNERS[SHOWN])
    np.testing.assert_allclose(products, (IMAGE * DESCRIPTORS[SHOWN]).sum(axis=1), atol=1e-5)


def test_only_those_that_are_asked_for_count() -> None:
    owners, _ = found(range(30, 50))
    assert owners.min() == 30 and owners.max() == 49
    asked = (OWNERS[SHOWN] >= 30) & (OWNERS[SHOWN] < 50)
    np.testing.assert_array_equal(owners[asked], OWNERS[SHOWN][asked])


def test_a_photograph_without_descriptors_is_never_nearest() -> None:
    index = DescriptorIndex(DESCRIPTORS[:EACH], np.full(EACH, 1))
    owners, products = index.nearest(IMAGE[:3], np.array([0, 1]))
    assert np.isneginf(products[:, 0]).all() and (owners == [0, 1]).all()


@pytest.mark.parametrize('installed', [True, False])
def test_of_many_the_same_are_found(installed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    few = found(range(PHOTOGRAPHS))
    monkeypatch.setattr(descriptor_index, 'MANY', 1000)
    searched = []

    def imported(name: str) -> object:
        searched.append(name)
        if not installed:
            raise ImportError(name)
        return import_module(name)

    if installed:
        pytest.importorskip('faiss', reason='faiss-cpu is not installed: an extra')
    monkeypatch.setattr(descriptor_index, 'import_module', imported)
    many = found(range(PHOTOGRAPHS))
    assert searched == ['faiss']
    same = many[0] == few[0]  # of neighbourhoods one in a hundred is missed
    assert same.mean() > (0.97 if installed else 0.999)
    np.testing.assert_allclose(many[1][same], few[1][same], atol=1e-5)
