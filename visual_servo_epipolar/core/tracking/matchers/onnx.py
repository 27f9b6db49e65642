"""
ONNX: a network of keypoints and descriptors in a file, by OpenCV's own engine.

Of an image, shape (1, 1, H, W) from 0 to 1, it gives maps of an eighth of its size: logits of 64
pixels and of none, (1, 65, H / 8, W / 8); descriptors, (1, C, H / 8, W / 8); and, if it has any,
reliabilities, (1, 1, H / 8, W / 8). XFeat (Potje et al. 2024) and SuperPoint (DeTone et al. 2018)
are such networks.
"""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, Image, IntArray
from visual_servo_epipolar.core.tracking.matchers.base import (
    Keypoints,
    mutual_nearest,
    NEIGHBOURS,
)
from visual_servo_epipolar.core.tracking.sampling import FloatImage, inside_border

CELL = 8  # side of a cell [px]
LOGITS = CELL * CELL + 1  # of a cell: of its pixels, and of none
STRIDE = 32  # sides are padded to multiples of it, the coarsest pixel of such a network [px]
LEAST_SCORE = 0.05  # of a keypoint, as in XFeat
PEAK = np.ones((5, 5), np.uint8)  # around a keypoint none has a higher score
# Of an image that is searched: a network has one size, and what is far away appears smaller.
# Small ones are enlarged too, up to ENOUGH_PIXELS: descriptors are 8 px apart.
SIZES, QUICK_SIZES, ENLARGED = (1.0, 0.71, 0.5), (0.71, 0.5), (1.41, 2.0)
ENOUGH_PIXELS = 1280 * 960
RATIO = 0.97  # of the nearest to the second nearest distance
SUPPORT = 2  # neighbours that must move along
ALONG, ALONG_PX = 0.6, 4.0  # of how far they are: views differ in size by a factor of two or so
# Images to try a network with: one of a fixed size takes one of them at most.
BLANKS = tuple(np.zeros((4 * STRIDE, side * STRIDE), np.float32) for side in (4, 5))
EXPORTED = 'export it as docs/examples/export_xfeat.py does'


class Onnx:
    """Matcher by the network of a file, which ``loaded`` reads; without one it finds nothing."""

    def __init__(self, network: 'Network | None' = None) -> None:
        self._network = network

    def loaded(self, path: str) -> 'Onnx':
        """Return the matcher by the network in the file ``path``, or raise ValueError."""
        return Onnx(_network(path))

    def describe(self, image: Image, *, limit: int, border: float) -> Keypoints:
        """Return the best keypoints of the photograph, ``limit`` of each size of it."""
        if self._network is None:
            return Keypoints.empty()
        keypoints = self._network.keypoints(image, limit, sizes_of(image.size))
        return keypoints.take(inside_border(keypoints.pixels, image.shape, border))

    def detect(self, image: Image, tuning: object, *, limit: int, quick: bool) -> Keypoints:
        """Return the best keypoints of ``image``, of fewer sizes of it if ``quick``."""
        if self._network is None:
            return Keypoints.empty()
        sizes = QUICK_SIZES if quick else sizes_of(image.size)
        return self._network.keypoints(image, limit, sizes)

    def pairs(self, desired: Keypoints, current: Keypoints) -> IntArray:
        """Return those that are each other's nearest, and that others around move along with."""
        pairs = mutual_nearest(desired.descriptors, current.descriptors, ratio=RATIO)
        before, after = desired.pixels[pairs[:, 0]], current.pixels[pairs[:, 1]]
        return pairs[supported(before, after)]


ONNX = Onnx()


def sizes_of(pixels: int) -> tuple[float, ...]:
    """Return the sizes at which an image of so many ``pixels`` is searched."""
    return (*SIZES, *(size for size in ENLARGED if size**2 * pixels <= ENOUGH_PIXELS))


def supported(before: FloatArray, after: FloatArray) -> BoolArray:
    """
    Return which matches, pixels of shape (N, 2) each, those around them move along with, (N,).

    Wrong ones go anywhere (Bian et al. 2017, with nearest neighbours instead of cells).
    """
    if len(before) <= NEIGHBOURS:
        return np.ones(len(before), bool)
    x, y = before.T
    squared = np.subtract.outer(x, x) ** 2
    squared += np.subtract.outer(y, y) ** 2
    np.fill_diagonal(squared, np.inf)
    near = np.argpartition(squared, NEIGHBOURS, axis=1)[:, :NEIGHBOURS]
    distance = np.sqrt(np.take_along_axis(squared, near, axis=1))
    shift = after - before
    off = np.linalg.norm(shift[near] - shift[:, None], axis=2)
    return np.asarray((off <= ALONG_PX + ALONG * distance).sum(axis=1) >= SUPPORT)


class Network:
    """Network of a file, and which of its outputs is what; ValueError if it is no such network."""

    def __init__(self, path: str) -> None:
        try:
            self._net = cv2.dnn.readNetFromONNX(np.frombuffer(Path(path).read_bytes(), np.uint8))
        except OSError as error:
            raise ValueError(
                f'matcher_model must be a readable file, got {path!r}: {error.strerror}'
            ) from None
        except cv2.error as error:
            raise ValueError(
                f'matcher_model must be an ONNX file that OpenCV reads, got {path!r}: '
                f'{_line(error)}; {EXPORTED}'
            ) from None
        self._names = self._net.getUnconnectedOutLayersNames()
        self._roles, self._length = self._roles_of_outputs(path)

    def _roles_of_outputs(self, path: str) -> tuple[tuple[int, int, int | None], int]:
        """Return which outputs are logits, descriptors, reliabilities, if any; descriptors' C."""
        try:
            tried = [[each.shape for each in self._outputs(blank)] for blank in BLANKS]
        except cv2.error as error:
            raise ValueError(
                f'matcher_model must take images of any size, shape (1, 1, H, W), got {path!r}: '
                f'{_line(error)}; {EXPORTED}'
            ) from None
        is_whole = [_are_maps(*each) for each in zip(tried, BLANKS, strict=True)]
        number = 0 if all(is_whole) else is_whole.index(False)
        shapes, (height, width) = tried[number], BLANKS[number].shape
        channels = [shape[1] if len(shape) == 4 else 0 for shape in shapes]
        others = [k for k, count in enumerate(channels) if count not in (0, 1, LOGITS)]
        if (
            not all(is_whole)
            or (channels.count(LOGITS), len(others)) != (1, 1)
            or channels.count(1) > 1
        ):
            raise ValueError(
                'matcher_model must give logits (1, 65, H/8, W/8), descriptors (1, C, H/8, W/8) '
                f'and perhaps reliabilities (1, 1, H/8, W/8), {path!r} gives of '
                f'{width}x{height} px {", ".join(map(str, shapes))}; {EXPORTED}'
            )
        reliability = channels.index(1) if 1 in channels else None
        return (channels.index(LOGITS), others[0], reliability), channels[others[0]]

    def _outputs(self, image: FloatImage) -> list[FloatImage]:
        self._net.setInput(image[None, None])
        return [np.asarray(each) for each in self._net.forward(self._names)]

    def keypoints(self, image: Image, limit: int, sizes: Sequence[float]) -> Keypoints:
        """Return the best of ``image``, uint8 of shape (H, W), ``limit`` of each of its sizes."""
        pixels, descriptors = [np.empty((0, 2))], [np.empty((0, self._length), np.float32)]
        for size in sizes:
            width, height = (round(size * side) for side in image.shape[::-1])
            if min(width, height) < STRIDE:
                continue
            way = cv2.INTER_AREA if size <= 1.0 else cv2.INTER_LINEAR
            scaled = cv2.resize(image, (width, height), interpolation=way)
            points, more = self._of_one_size(np.asarray(scaled, np.uint8), limit)
            points = (points + 0.5) * (image.shape[1] / width, image.shape[0] / height) - 0.5
            pixels.append(np.clip(points, 0.0, np.array(image.shape[::-1]) - 1.0))
            descriptors.append(more)
        points = np.concatenate(pixels)
        ones = np.ones(len(points))
        return Keypoints(points, ones, 0.0 * ones, np.concatenate(descriptors))

    def _of_one_size(self, image: Image, limit: int) -> tuple[FloatArray, FloatImage]:
        """Return pixels, (N, 2), and descriptors, (N, C), of the ``limit`` best keypoints."""
        height, width = image.shape
        below, right = -height % STRIDE, -width % STRIDE
        padded = cv2.copyMakeBorder(image, 0, below, 0, right, cv2.BORDER_REPLICATE)
        outputs = self._outputs(padded.astype(np.float32) / 255.0)
        logits, descriptors, reliability = self._roles
        scores = _scores(outputs[logits][0])
        is_peak = (scores >= cv2.dilate(scores, PEAK)) & (scores > LEAST_SCORE)
        if reliability is not None:
            scores = scores * cv2.resize(outputs[reliability][0, 0], scores.shape[::-1])
        rows, columns = np.nonzero(is_peak[:height, :width])
        best = np.sort(np.argsort(-scores[rows, columns], kind='stable')[:limit])
        pixels = np.stack([columns[best], rows[best]], axis=1).astype(np.float64)
        return pixels, _sampled(outputs[descriptors][0], pixels)


def _are_maps(shapes: Sequence[tuple[int, ...]], image: FloatImage) -> bool:
    """Return whether ``shapes`` of outputs are those of maps of an eighth of ``image``."""
    cells = tuple(side // CELL for side in image.shape)
    return all(len(shape) == 4 and shape[2:] == cells for shape in shapes)


def _scores(logits: FloatImage) -> FloatImage:
    """Return the score of each pixel, shape (H, W), of the logits of cells, (65, H / 8, W / 8)."""
    shares = np.exp(logits - logits.max(axis=0))
    shares /= shares.sum(axis=0)
    _, rows, columns = shares.shape
    pixels = shares[: CELL * CELL].reshape(CELL, CELL, rows, columns).transpose(2, 0, 3, 1)
    return np.ascontiguousarray(pixels.reshape(CELL * rows, CELL * columns))


def _sampled(descriptors: FloatImage, pixels: FloatArray) -> FloatImage:
    """Return the unit descriptors, (N, C), at ``pixels``, (N, 2), of a map, (C, H / 8, W / 8)."""
    x, y = ((pixels + 0.5) / CELL - 0.5).T
    _, rows, columns = descriptors.shape
    x, y = np.clip(x, 0.0, columns - 1.0), np.clip(y, 0.0, rows - 1.0)
    left = np.minimum(x.astype(np.int64), max(columns - 2, 0))
    top = np.minimum(y.astype(np.int64), max(rows - 2, 0))
    sampled = np.zeros((len(descriptors), len(pixels)), np.float32)
    for down in (0, 1):
        for right in (0, 1):
            share = np.abs(1 - right - (x - left)) * np.abs(1 - down - (y - top))
            corner = descriptors[:, top + down, left + right]
            sampled += share.astype(np.float32) * corner
    norm = np.linalg.norm(sampled, axis=0)
    return np.ascontiguousarray((sampled / np.where(norm > 0.0, norm, 1.0)).T)


_network = lru_cache(maxsize=2)(Network)


def _line(error: cv2.error) -> str:
    return ' '.join(str(error.err or error).split())[:200]
