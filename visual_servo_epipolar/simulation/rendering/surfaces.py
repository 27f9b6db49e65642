"""Textured rectangles: grey pictures and their prefiltered copies, the order to paint them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
import math

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import (
    as_gray,
    BoolArray,
    FloatArray,
    frozen,
    Image,
    IntArray,
)

# Blur of the imaginary lens and pixel together [px]. Less aliases, more looks out of focus: at
# 0.42 px a contrast of 42 % is left at the Nyquist frequency and 6 % at the pixel frequency.
LENS_SIGMA = 0.42
# What a copy is blurred already, drawn or reduced, and by bilinear sampling [texel^2].
TEXEL_VARIANCE = 0.5
DOUBLED_VARIANCE = 1.6
# The sharpest copy, the doubled one, is blurred as if a pixel spanned so many texels.
SHARPEST = math.sqrt(DOUBLED_VARIANCE) / (2.0 * LENS_SIGMA)


class Texture:
    """
    A grey picture and its copies, blurred and reduced along rows and columns separately.

    Copies are counted in half octaves (p, q): copy (p, q) is fit to be sampled bilinearly where
    one pixel of the image spans 2^(p/2) texels along a row and 2^(q/2) along a column. They are
    made where and when they are first asked for, and keep two to three texels a pixel: bilinear
    sampling of fewer would shift details by some hundredths of a pixel. The original is doubled
    if it has fewer.
    """

    def __init__(self, image: Image) -> None:
        self.image: Image = frozen(as_gray(image, 'texture'))
        self._reduced: dict[tuple[int, int], Image] = {(0, 0): self.image}
        self._filtered: dict[tuple[int, int], tuple[Image, int, int]] = {}

    def filtered(self, p: int, q: int) -> tuple[Image, int, int]:
        """Return copy (p, q), and how often its columns and rows were halved."""
        if (p, q) not in self._filtered:
            i, j = (p - 2) // 2, (q - 2) // 2
            sigmas = _sigma(2.0 ** (p / 2 - i), i), _sigma(2.0 ** (q / 2 - j), j)
            self._filtered[p, q] = _blur(self._level(i, j), *sigmas), i, j
        return self._filtered[p, q]

    def _level(self, i: int, j: int) -> Image:
        """Return the picture with columns halved i times and rows j times; -1 is doubled."""
        if (i, j) not in self._reduced:
            if i > 0:
                columns = cv2.transpose(self._level(i - 1, j))
                picture = np.asarray(cv2.transpose(_halved(columns)), np.uint8)
            elif j > 0:
                picture = _halved(self._level(i, j - 1))
            else:
                size = {'fx': 1 + (i < 0), 'fy': 1 + (j < 0)}
                larger = cv2.resize(self.image, None, **size, interpolation=cv2.INTER_CUBIC)
                picture = np.asarray(larger, np.uint8)
            self._reduced[i, j] = picture
        return self._reduced[i, j]


def _sigma(texels_a_pixel: float, halvings: int) -> float:
    """Return the blur [texels] still missing where a pixel spans ``texels_a_pixel``."""
    variance = DOUBLED_VARIANCE if halvings < 0 else TEXEL_VARIANCE
    return math.sqrt(max(0.0, (LENS_SIGMA * texels_a_pixel) ** 2 - variance))


def _blur(source: Image, sigma_u: float, sigma_v: float) -> Image:
    """Blur columns and rows by their own Gaussian; a sigma of 0 leaves them alone."""
    if sigma_u == 0.0 and sigma_v == 0.0:
        return source
    size = 2 * math.ceil(3.0 * sigma_u) + 1, 2 * math.ceil(3.0 * sigma_v) + 1
    # OpenCV reads a sigma of 0 as "choose one"; a kernel of one tap ignores it.
    sigmas = {'sigmaX': max(sigma_u, 0.1), 'sigmaY': max(sigma_v, 0.1)}
    blurred = cv2.GaussianBlur(source, size, **sigmas, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(blurred, np.uint8)


def _halved(picture: Image) -> Image:
    """Halve the rows by (1 3 3 1) / 8; where they are odd the last one counts twice."""
    padded = np.pad(picture, ((1, 1 + len(picture) % 2), (0, 0)), 'edge')
    total = cv2.add(padded[1:-1:2], padded[2:-1:2], dtype=cv2.CV_16U)
    total *= 3
    total += cv2.add(padded[:-2:2], padded[3::2], dtype=cv2.CV_16U)
    total += 4
    total >>= 3
    return np.asarray(total.astype(np.uint8))


ROOM = 'room'


@dataclass(frozen=True, eq=False)
class Surface:
    """
    A rectangle seen from one side: its upper left corner, and its edges to the right and down [m].

    Surfaces of one ``body`` belong to one convex solid, or to the shell of the room.
    """

    name: str
    body: str
    origin: FloatArray
    edge_u: FloatArray
    edge_v: FloatArray
    texture: Texture

    def __post_init__(self) -> None:
        for name in ('origin', 'edge_u', 'edge_v'):
            object.__setattr__(self, name, frozen(np.asarray(getattr(self, name), np.float64)))
        if abs(float(self.edge_u @ self.edge_v)) > 1e-9:
            raise ValueError(
                f'edges of {self.name} must be at right angles, got {self.edge_u} and '
                f'{self.edge_v}; surfaces are rectangles'
            )

    @property
    def corners(self) -> FloatArray:
        """Corners, shape (4, 3), clockwise as seen from before the surface."""
        u, v = self.edge_u, self.edge_v
        return self.origin + np.stack([0.0 * u, u, u + v, v])

    @property
    def normal(self) -> FloatArray:
        """Unit normal, shape (3,), towards the side it is seen from."""
        normal = np.cross(self.edge_v, self.edge_u)
        return np.asarray(normal / np.linalg.norm(normal))


@dataclass(frozen=True, eq=False)
class Scene:
    """All surfaces of a world; the body called 'room' is behind everything else."""

    surfaces: tuple[Surface, ...]
    corners: FloatArray = field(init=False)
    normals: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        if not self.surfaces:
            raise ValueError('a scene must have at least one surface, got none; add a wall')
        corners = np.stack([surface.corners for surface in self.surfaces])
        normals = np.stack([surface.normal for surface in self.surfaces])
        object.__setattr__(self, 'corners', frozen(corners))
        object.__setattr__(self, 'normals', frozen(normals))

    def bare(self) -> 'Scene':
        """Return the scene without its pictures: enough for geometry, and small."""
        blank = Texture(np.zeros((1, 1), np.uint8))
        return Scene(tuple(replace(surface, texture=blank) for surface in self.surfaces))

    @cached_property
    def texture_sizes(self) -> IntArray:
        """Width and height of the texture of each surface, shape (N, 2) [texel]."""
        shapes = [surface.texture.image.shape[::-1] for surface in self.surfaces]
        return np.array(shapes, np.int64)

    @cached_property
    def bodies(self) -> IntArray:
        """Number of the body of each surface, shape (N,); the room is 0."""
        names = [ROOM, *sorted({s.body for s in self.surfaces} - {ROOM})]
        return np.array([names.index(surface.body) for surface in self.surfaces], np.int64)

    @cached_property
    def _solids(self) -> list[FloatArray]:
        """Corners of each body but the room, shape (M, 3)."""
        count = int(self.bodies.max())
        return [self.corners[self.bodies == k].reshape(-1, 3) for k in range(1, count + 1)]

    @cached_property
    def _separations(self) -> tuple[IntArray, IntArray, IntArray]:
        """Faces of solids with another one wholly before them: the face, its own, the other."""
        offsets = np.einsum('ij,ij->i', self.normals, self.corners[:, 0])
        clearance = [(solid @ self.normals.T - offsets).min(axis=0) for solid in self._solids]
        before, faces = np.nonzero(
            (np.array(clearance).reshape(-1, len(offsets)) > -1e-6) & (self.bodies > 0)
        )
        return faces, self.bodies[faces] - 1, before

    def facing(self, centre: FloatArray) -> BoolArray:
        """Return which surfaces, shape (N,), show their face to a camera at ``centre``."""
        towards = ((centre - self.corners[:, 0]) * self.normals).sum(axis=1)
        return np.asarray(towards > 1e-6)

    def back_to_front(self, centre: FloatArray) -> Sequence[int]:
        """
        Return the bodies in an order in which nearer ones are painted over farther ones.

        Of two bodies on either side of a plane, the one on the camera's side is nearer. Should
        three bodies overlap in a ring, the one farthest from ``centre``, shape (3,), goes first.
        """
        faces, behind, before = self._separations
        towards = self.facing(centre)[faces]
        middles = np.array([solid.mean(axis=0) for solid in self._solids]).reshape(-1, 3)
        may_cover = np.ones((len(middles), len(middles)), bool)
        may_cover[np.where(towards, behind, before), np.where(towards, before, behind)] = False
        waits = may_cover & ~may_cover.T  # for those that lie behind it
        order, left = [0], np.argsort(-np.linalg.norm(middles - centre, axis=1), kind='stable')
        while len(left):
            hides = np.asarray(waits[np.ix_(left, left)].any(axis=1))
            hides[0] &= not hides.all()
            order += (left[~hides] + 1).tolist()
            left = left[hides]
        return order
