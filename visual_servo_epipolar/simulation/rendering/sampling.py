"""Texture sampling: grey values for the strips of the raster, one by one."""

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.simulation.rendering.edges import smooth_edges
from visual_servo_epipolar.simulation.rendering.raster import Raster, Strip, View
from visual_servo_epipolar.simulation.rendering.surfaces import Scene

FLAGS = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP


def shade(scene: Scene, view: View, raster: Raster) -> Image:
    """Return the image, shape (H, W), of what the raster shows; black where it shows nothing."""
    image: Image = np.zeros((view.height, view.width), dtype=np.uint8)
    if not raster.strips:
        return image
    sources = _sources(scene, raster)
    for number, (strip, box, source) in enumerate(
        zip(raster.strips, raster.boxes, sources, strict=True), start=1
    ):
        left, top, right, bottom = box
        if left >= right or top >= bottom:
            continue
        # Not cv2.compare: it takes the number for an array where the box is a single pixel.
        mask = np.equal(raster.ids[top:bottom, left:right], number).view(np.uint8)
        x, y, width, height = cv2.boundingRect(mask)
        if width > 0:
            part = _sample(strip, *source, (left + x, top + y, width, height))
            area = image[top + y : top + y + height, left + x : left + x + width]
            cv2.copyTo(part, mask[y : y + height, x : x + width], area)
    return smooth_edges(image, scene, view, raster)


def _sources(scene: Scene, raster: Raster) -> list[tuple[Image, FloatArray]]:
    """Return for each strip the picture to sample, and the map from pixels to its texels."""
    place = {surface: k for k, surface in enumerate(raster.shown.tolist())}
    pictures, texels, maps = [], [], []
    for strip in raster.strips:
        texture = scene.surfaces[strip.surface].texture
        picture, i, j = texture.filtered(strip.p, strip.q)
        rows, columns = texture.image.shape
        # Texel t of the original is texel (t + 1/2) / 2^i - 1/2 of a copy halved i times.
        texels.append([[columns / 2**i, 0.0, -0.5], [0.0, rows / 2**j, -0.5], [0.0, 0.0, 1.0]])
        pictures.append(picture)
        maps.append(place[strip.surface])
    return list(zip(pictures, np.array(texels) @ raster.maps[maps], strict=True))


def _sample(
    strip: Strip, picture: Image, texels: FloatArray, area: tuple[int, int, int, int]
) -> Image:
    """Sample a picture in the area (x, y, width, height) of the image."""
    x, y, width, height = area
    n, m = strip.columns, strip.rows
    # Part k of the n parts of pixel x is centred at x + (k + 1/2) / n - 1/2.
    pixels = np.array(
        [[1.0 / n, 0.0, x + 0.5 / n - 0.5], [0.0, 1.0 / m, y + 0.5 / m - 0.5], [0.0, 0.0, 1.0]]
    )
    size = (n * width, m * height)
    part = cv2.warpPerspective(
        picture, texels @ pixels, size, flags=FLAGS, borderMode=cv2.BORDER_REPLICATE
    )
    if n * m > 1:
        part = cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(part, dtype=np.uint8)
