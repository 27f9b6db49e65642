"""Textured rectangles, and the order in which to paint them."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, frozen, IntArray
from visual_servo_epipolar.simulation.rendering.textures import Texture

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

    def seen_from(self, centre: FloatArray) -> 'Scene':
        """Return what of it may be seen from ``centre``, shape (3,): all of a room."""
        return self

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
    def body_centres(self) -> FloatArray:
        """Mean corner of each body, shape (B, 3); of the room, if it has surfaces."""
        count = int(self.bodies.max()) + 1
        return np.stack(
            [
                self.corners[self.bodies == k].reshape(-1, 3).mean(axis=0)
                if (self.bodies == k).any()
                else np.zeros(3)
                for k in range(count)
            ]
        )

    @cached_property
    def _separations(self) -> tuple[IntArray, IntArray, IntArray]:
        """Faces with a body wholly before them: the face, its own body, the body before it."""
        offsets = np.einsum('ij,ij->i', self.normals, self.corners[:, 0])
        clearance = np.stack(
            [
                (self.corners[self.bodies == k].reshape(-1, 3) @ self.normals.T - offsets).min(
                    axis=0
                )
                if (self.bodies == k).any()
                else np.full(len(offsets), -1.0)
                for k in range(len(self.body_centres))
            ]
        )
        before, faces = np.nonzero((clearance > -1e-6) & (self.bodies > 0))
        keep = before > 0
        return faces[keep], self.bodies[faces[keep]], before[keep]

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
        count = len(self.body_centres)
        may_cover = np.ones((count, count), dtype=bool)
        may_cover[np.where(towards, behind, before), np.where(towards, before, behind)] = False
        waits = np.packbits(may_cover & ~may_cover.T, axis=1, bitorder='little')
        behind_of = [int.from_bytes(row.tobytes(), 'little') for row in waits]  # a bit a body
        distance = np.linalg.norm(self.body_centres - centre, axis=1).tolist()
        remaining, order = sorted(range(1, count), key=lambda k: -distance[k]), [0]
        while remaining:
            left = sum(1 << k for k in remaining)
            free = [k for k in remaining if not behind_of[k] & left] or remaining[:1]
            order += free
            remaining = [k for k in remaining if k not in free]
        return order
