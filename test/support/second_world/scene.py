"""
A room rasterised by OpenCV alone, which shares no code with the package's renderer and rooms.

Flat panels, far ones first: each is warped by its homography from a mip level of a picture of
shapes and letters, and painted over what is behind it. World axes: x right of the goal, y ahead of
it, z up [m]; camera axes: right, down, forward.
"""

from dataclasses import dataclass, field
import math
import string

import cv2
import numpy as np

from visual_servo_epipolar.core.cameras.pinhole import Camera

TEXEL = 0.005  # [m]
NEAR = 0.1  # [m]
SUBPIXEL = 4  # bits of the corners of a panel
LEVELS = 5  # of the pyramid of a picture
AXES = np.eye(3)


@dataclass(frozen=True, eq=False)
class Panel:
    """A rectangle: corners from the upper left one on, shape (4, 3) [m]; its picture's pyramid."""

    corners: np.ndarray
    pyramid: list[np.ndarray]
    middle: np.ndarray = field(init=False)
    away: np.ndarray = field(init=False)  # normal that points out of its back

    def __post_init__(self) -> None:
        right, down = self.corners[1] - self.corners[0], self.corners[3] - self.corners[0]
        object.__setattr__(self, 'middle', self.corners.mean(axis=0))
        object.__setattr__(self, 'away', np.cross(right, down))


def panel(rng: np.random.Generator, corner, right, down, contrast: float) -> Panel:
    """Return a panel with a picture of random shapes and letters, blurred by the print."""
    corner, right, down = (np.asarray(item, float) for item in (corner, right, down))
    corners = np.array([corner, corner + right, corner + right + down, corner + down])
    width, height = (max(16, round(np.linalg.norm(edge) / TEXEL)) for edge in (right, down))
    picture = np.full((height, width), round(rng.uniform(90, 160)), np.uint8)
    for _ in range(max(6, width * height // 900)):
        grey = 128.0 + contrast * rng.uniform(-110, 110)
        _print(rng, picture, rng.uniform(0, (width, height)), rng.uniform(3, 30), grey)
    pyramid = [cv2.GaussianBlur(picture, (0, 0), 1.2)]
    while len(pyramid) < LEVELS and min(pyramid[-1].shape) > 16:
        # Not pyrDown, which moves a picture by half a texel.
        half = (pyramid[-1].shape[1] // 2, pyramid[-1].shape[0] // 2)
        pyramid.append(cv2.resize(pyramid[-1], half, interpolation=cv2.INTER_AREA))
    return Panel(corners, pyramid)


def _print(rng: np.random.Generator, picture, place, size: float, grey: float) -> None:
    """Print an ellipse, a triangle or a letter of ``size`` texels."""
    kind, (x, y) = rng.integers(3), place.astype(int).tolist()
    if kind == 0:
        axes = rng.uniform(0.4 * size, size, 2).astype(int).tolist()
        cv2.ellipse(picture, (x, y), axes, rng.uniform(0, 180), 0, 360, grey, -1)
    elif kind == 1:
        corners = (place + rng.uniform(-size, size, (3, 2))).astype(np.int32)
        cv2.fillConvexPoly(picture, corners, grey)
    else:
        letter = string.ascii_uppercase[rng.integers(26)]
        cv2.putText(picture, letter, (x, y), cv2.FONT_HERSHEY_DUPLEX, size / 14, grey, 3)


def box(rng: np.random.Generator, x: float, y: float, size) -> list[Panel]:
    """Return front, both sides and top of a box on the floor; (x, y) is its middle."""
    w, d, h = size
    left, near = x - 0.5 * w, y - 0.5 * d
    across, along, up = w * AXES[0], d * AXES[1], h * AXES[2]
    return [
        panel(rng, (left, near, h), across, -up, 1.0),
        panel(rng, (left, near + d, h), -along, -up, 0.8),
        panel(rng, (left + w, near, h), along, -up, 0.8),
        panel(rng, (left, near + d, h), across, -along, 0.9),
    ]


def workshop(seed: int) -> tuple[list[Panel], list[Panel]]:
    """Return the room's own panels, and those of the crates and shelves that stand in it."""
    rng = np.random.default_rng(seed)
    room = [panel(rng, (-3.6, 4.8, 2.8), 3.6 * AXES[0], -2.8 * AXES[2], 0.7)]
    room += [panel(rng, (0.0, 4.8, 2.8), 3.6 * AXES[0], -2.8 * AXES[2], 0.7)]
    for y in np.arange(-7.2, 4.8, 2.4):
        room += [panel(rng, (-3.6, y, 2.8), 2.4 * AXES[1], -2.8 * AXES[2], 0.6)]
        room += [panel(rng, (3.6, y + 2.4, 2.8), -2.4 * AXES[1], -2.8 * AXES[2], 0.6)]
        for x in (-3.6, -1.2, 1.2):
            room += [panel(rng, (x, y + 2.4, 0.0), 2.4 * AXES[0], -2.4 * AXES[1], 0.2)]
            room += [panel(rng, (x, y, 2.8), 2.4 * AXES[0], 2.4 * AXES[1], 0.3)]
    stands = [
        ((-1.9, 1.6), (0.5, 0.4, 0.6)),
        ((-1.1, 3.3), (0.9, 0.5, 1.5)),
        ((-0.2, 4.2), (0.6, 0.6, 0.8)),
        ((0.5, 2.6), (0.4, 0.4, 0.5)),
        ((1.3, 3.8), (0.8, 0.6, 1.2)),
        ((1.9, 2.0), (0.5, 0.5, 0.9)),
        ((2.6, 3.4), (0.7, 0.4, 1.9)),
        ((-2.7, 3.0), (0.6, 0.6, 1.1)),
    ]
    return room, [face for (x, y), size in stands for face in box(rng, x, y, size)]


class Painter:
    """Takes pictures of a room: an ideal canvas with a rim, seen through the lens, with noise."""

    RIM = 40  # [px]

    def __init__(self, camera: Camera, seed: int) -> None:
        self._room, self._things = workshop(seed)
        width, height = camera.width, camera.height
        self._size = width + 2 * self.RIM, height + 2 * self.RIM
        middle = 0.5 * self._size[0], 0.5 * self._size[1]
        self._matrix = np.diag([camera.fx, camera.fx, 1.0])
        self._matrix[:2, 2] = middle
        pixels = np.stack(np.meshgrid(np.arange(float(width)), np.arange(float(height))), axis=-1)
        x, y, z = camera.rays(pixels.reshape(-1, 2)).T.reshape(3, height, width)
        x, y = x / z, y / z
        self._map_u = (camera.fx * x + middle[0]).astype(np.float32)
        self._map_v = (camera.fx * y + middle[1]).astype(np.float32)
        self._light = (1.0 - 0.25 * (x * x + y * y)).astype(np.float32)
        rng = np.random.default_rng(seed + 1)
        self._noise = rng.normal(0.0, 1.5, (height + 97, width + 97)).astype(np.float32)

    def picture(self, axes: np.ndarray, centre: np.ndarray, frame: int) -> np.ndarray:
        """Return a picture, uint8; the columns of ``axes`` are right, down and forward."""
        canvas = np.full(self._size[::-1], 128, np.uint8)
        for group in (self._room, self._things):
            for item in sorted(group, key=lambda it: -np.linalg.norm(it.middle - centre)):
                if item.away @ (item.middle - centre) > 0.0:
                    self._paint(canvas, item, axes, centre)
        seen = cv2.remap(canvas, self._map_u, self._map_v, cv2.INTER_LINEAR).astype(np.float32)
        row, column = (31 * frame) % 97, (57 * frame) % 97
        height, width = seen.shape
        noise = self._noise[row : row + height, column : column + width]
        return np.clip(seen * self._light + noise + 0.5, 0, 255).astype(np.uint8)

    def _paint(self, canvas: np.ndarray, item: Panel, axes, centre) -> None:
        outline = _clipped((item.corners - centre) @ axes)
        if len(outline) < 3:
            return
        projected = outline @ self._matrix.T
        outline = projected[:, :2] / projected[:, 2:]
        low = np.maximum(np.floor(outline.min(axis=0)).astype(int), 0)
        high = np.minimum(np.ceil(outline.max(axis=0)).astype(int) + 1, self._size)
        if (high <= low).any():
            return
        part = canvas[low[1] : high[1], low[0] : high[0]]
        corner, right, _, down = item.corners
        columns = np.column_stack([right - corner, down - corner, corner - centre])
        shift = np.array([[1.0, 0.0, -low[0]], [0.0, 1.0, -low[1]], [0.0, 0.0, 1.0]])
        from_unit = shift @ self._matrix @ axes.T @ columns
        picture = item.pyramid[_level(from_unit, item.pyramid)]
        height, width = picture.shape
        # Texel k spans k to k + 1 of the picture; OpenCV counts from its middle.
        to_unit = np.array([[1 / width, 0, 0.5 / width], [0, 1 / height, 0.5 / height], [0, 0, 1]])
        size = part.shape[::-1]
        warped = cv2.warpPerspective(
            picture, from_unit @ to_unit, size, borderMode=cv2.BORDER_REPLICATE
        )
        mask = np.zeros(part.shape, np.uint8)
        corners = np.rint((outline - low) * 2**SUBPIXEL).astype(np.int32)
        cv2.fillConvexPoly(mask, corners, 255, cv2.LINE_AA, SUBPIXEL)
        cover = mask.astype(np.float32) * np.float32(1 / 255)
        part[:] = cv2.blendLinear(warped, part, cover, 1.0 - cover)


def _clipped(corners: np.ndarray) -> np.ndarray:
    """Return the part of a polygon, in camera axes, that lies before the near plane."""
    kept = []
    for one, other in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        if one[2] >= NEAR:
            kept.append(one)
        if (one[2] >= NEAR) != (other[2] >= NEAR):
            kept.append(one + (other - one) * (NEAR - one[2]) / (other[2] - one[2]))
    return np.array(kept)


def _level(from_unit: np.ndarray, pyramid: list[np.ndarray]) -> int:
    """Return the level whose texels are about as large as pixels in the middle of the panel."""
    depth = float(from_unit[2] @ [0.5, 0.5, 1.0])
    if depth < NEAR:
        return 0
    area = abs(float(np.linalg.det(from_unit))) / depth**3  # of the image of the whole picture
    height, width = pyramid[0].shape
    texels = math.sqrt(width * height / max(area, 1.0))  # to a pixel, along either axis
    return min(round(math.log2(max(texels, 1.0))), len(pyramid) - 1)
