"""Texture sampling: grey values for the strips of the raster, one by one."""

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.simulation.rendering.raster import Box, MAX_SUBDIVISION, Raster
from visual_servo_epipolar.simulation.rendering.surfaces import Scene, Sheet

FLAGS = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
WASTE = 12000  # samples beside a strip that cost no more than to look closer
TEXELS_AHEAD = 12  # a box of more texels a sample is mostly not sampled


class Area(NamedTuple):
    """A rectangle of the image with pixels of one strip."""

    number: int  # of the strip, from 1
    box: Box  # left, top, right, bottom, the last two exclusive
    mask: Image | None  # where it shows the strip; None if it shows nothing else


def draw_textures(scene: Scene, raster: Raster, image: Image) -> None:
    """Sample the textures of all strips into ``image``, shape (H, W)."""
    areas = list(_areas(raster))
    if not areas:
        return
    sheets, texels = _sources(scene, raster, areas)
    boxes = _texel_boxes(raster, areas, sheets, texels)
    means: Image = np.empty(image.size, np.uint8)
    samples: Image = np.empty(MAX_SUBDIVISION * image.size, np.uint8)
    for area, sheet, matrix, (box, dense) in zip(areas, sheets, texels, boxes, strict=True):
        number, (left, top, right, bottom), mask = area
        picture = sheet.made(box)
        target, strip = image[top:bottom, left:right], raster.strips[number - 1]
        whole = strip.columns == strip.rows == 1
        mean = target if mask is None else means[: target.size].reshape(target.shape)
        size = (right - left) * strip.columns, (bottom - top) * strip.rows
        parts = mean if whole else samples[: size[0] * size[1]].reshape(size[::-1])
        if dense:  # for the cache alone: line by line is faster than in the order of the samples
            picture[box[1] : box[3], box[0] : box[2] : 64].max(initial=0)  # a cache line each
        cv2.warpPerspective(picture, matrix, size, parts, FLAGS, cv2.BORDER_REPLICATE)
        if not whole:
            _average(parts, mean)
        if mask is not None:
            cv2.copyTo(mean, mask, target)


def _areas(raster: Raster) -> Iterator[Area]:
    """Yield areas that hold all pixels of the strips, and few others."""
    sizes = [
        max(right - left, 0) * max(bottom - top, 0) for left, top, right, bottom in raster.boxes
    ]
    masks: Image = np.empty(sum(sizes), np.uint8)
    for number, (strip, box) in enumerate(zip(raster.strips, raster.boxes, strict=True), start=1):
        left, top, right, bottom = box
        if left >= right or top >= bottom:
            continue
        shape = bottom - top, right - left
        mask = masks[: shape[0] * shape[1]].reshape(shape)
        masks = masks[mask.size :]
        # Not cv2.compare: it takes the number for an array where the box is a single pixel.
        np.equal(raster.ids[top:bottom, left:right], number, out=mask.view(bool))
        for (x0, y0, x1, y1), full in _cover(mask, WASTE // (strip.columns * strip.rows)):
            area = left + x0, top + y0, left + x1, top + y1
            yield Area(number, area, None if full else mask[y0:y1, x0:x1])


def _cover(mask: Image, waste: int) -> Iterator[tuple[Box, bool]]:
    """
    Yield boxes that hold all of a mask, and whether they are full.

    A box with more than ``waste`` pixels beside the mask is halved.
    """
    remaining: list[Box] = [(0, 0, mask.shape[1], mask.shape[0])]
    while remaining:
        left, top, right, bottom = remaining.pop()
        part = mask[top:bottom, left:right]
        count = cv2.countNonZero(part)
        if count == 0:
            continue
        if count < part.size:
            x, y, width, height = cv2.boundingRect(part)
            left, top = left + x, top + y
            right, bottom = left + width, top + height
        beside = (right - left) * (bottom - top) - count
        if beside <= waste:
            yield (left, top, right, bottom), beside == 0
        elif right - left > bottom - top:
            middle = (left + right) // 2
            remaining += [(left, top, middle, bottom), (middle, top, right, bottom)]
        else:
            middle = (top + bottom) // 2
            remaining += [(left, top, right, middle), (left, middle, right, bottom)]


def _sources(scene: Scene, raster: Raster, areas: list[Area]) -> tuple[list[Sheet], FloatArray]:
    """
    Return for each area the sheet to sample, and the map to its texels.

    The maps, shape (A, 3, 3), are from parts of pixels, counted from the upper left of the area.
    """
    place = {surface: k for k, surface in enumerate(raster.shown.tolist())}
    sources = {}
    for number in dict.fromkeys(area.number for area in areas):
        strip = raster.strips[number - 1]
        texture = scene.surfaces[strip.surface].texture
        sheet, i, j = texture.filtered(strip.p, strip.q)
        rows, columns = texture.image.shape
        scale = columns / 2**i, rows / 2**j, strip.columns, strip.rows, place[strip.surface]
        sources[number] = sheet, scale
    sheets = [sources[area.number][0] for area in areas]
    strips = np.array([sources[area.number][1] for area in areas])
    corners = np.array([area.box[:2] for area in areas]).reshape(-1, 2)
    maps = raster.maps[strips[:, 4].astype(np.int64)]
    # Texel t of the original is texel (t + 1/2) / 2^i - 1/2 of a copy halved i times.
    texels = strips[:, :2, None] * maps[:, :2] - 0.5 * maps[:, 2:]
    maps = np.concatenate([texels, maps[:, 2:]], axis=1)
    # Part k of the n parts of pixel x is centred at x + (k + 1/2) / n - 1/2.
    parts = strips[:, None, 2:4]
    first = corners[:, None] + 0.5 / parts - 0.5
    origin = (maps[:, :, :2] * first).sum(axis=2) + maps[:, :, 2]
    return sheets, np.concatenate([maps[:, :, :2] / parts, origin[:, :, None]], axis=2)


def _texel_boxes(
    raster: Raster, areas: list[Area], sheets: list[Sheet], maps: FloatArray
) -> Iterator[tuple[Box, bool]]:
    """
    Return for each area the box of texels that its samples are taken from, and if most of it is.

    That box is the whole sheet for an area that ends beyond the horizon. ``maps`` are those of
    the areas, shape (A, 3, 3), from parts of pixels to texels.
    """
    numbers = [area.number - 1 for area in areas]
    strips = np.array([(strip.columns, strip.rows) for strip in raster.strips])[numbers]
    boxes = np.array([area.box for area in areas])
    width, height = ((boxes[:, 2:] - boxes[:, :2]) * strips).T
    zero = np.zeros(len(areas))
    corners = np.array([[zero, width, zero, width], [zero, zero, height, height]])
    ends = np.einsum('aij,jka->ika', maps[:, :, :2], corners) + maps.T[2][:, None]
    ahead = ends[2] > 0.0
    limits = np.array([sheet.shape[::-1] for sheet in sheets]).T
    texels = np.clip(ends[:2] / np.where(ahead, ends[2], np.inf), 0.0, limits[:, None])
    seen = ahead.all(axis=0)
    low = np.where(seen, np.maximum(texels.min(axis=1).astype(int) - 1, 0), 0)
    high = np.where(seen, np.minimum(texels.max(axis=1).astype(int) + 3, limits), limits)
    # A sample beside the sheet takes the nearest texel: there is one in every box.
    low = np.minimum(low, limits - 1)
    dense = seen & ((high - low).prod(axis=0) < TEXELS_AHEAD * width * height)
    return zip(map(tuple, np.concatenate([low, high]).T.tolist()), dense.tolist(), strict=True)


def _average(parts: Image, mean: Image) -> None:
    """Store in ``mean``, (H, W), that of ``parts``, (H m, W n); a half is rounded to even."""
    height, width = mean.shape
    rows = len(parts) // height
    if parts.shape[1] > width:
        cv2.resize(parts, (width, height), mean, interpolation=cv2.INTER_AREA)
    elif rows == 2:
        cv2.addWeighted(parts[::2], 0.5, parts[1::2], 0.5, 0.0, mean)
    else:
        total = np.zeros(mean.shape, np.float32)
        for k in range(rows):
            cv2.accumulate(parts[k::rows], total)
        cv2.convertScaleAbs(total, mean, 1.0 / rows)
