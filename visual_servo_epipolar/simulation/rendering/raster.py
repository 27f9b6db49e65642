"""
Rasterizer: surfaces cut into strips of like scale, numbered from back to front, and drawn.

Textures are drawn strip by strip, then edges, placed sub-pixel exactly.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
import math
from typing import NamedTuple, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.arrays import FloatArray, Image, IntArray
from visual_servo_epipolar.simulation.rendering.surfaces import Scene, SHARPEST

MAX_SKEW = 1.5  # area blurred by texture copies over area of a pixel, before it is subdivided
MAX_SUBDIVISION = 8
WORTHWHILE = 0.93  # more parts must reduce the blurred area to so much of it
# Into how many columns and rows a pixel may be cut, the fewest first, shape (N, 2).
SUBDIVISIONS = np.array(
    [(1, 1), *(pair for n in range(2, MAX_SUBDIVISION + 1) for pair in ((1, n), (n, 1)))]
)
SPREAD = 0.7  # a part is judged at its corners, drawn in to its middle so much


class Strip(NamedTuple):
    """A part of a surface that is sampled in one way."""

    surface: int
    side: int  # of the image: -1, 0, 1
    p: int  # copy (p, q) of the texture
    q: int
    columns: int  # subdivisions of a pixel
    rows: int


class Parts(NamedTuple):
    """Parts of surfaces, each sampled in one way: corners [px], shape (C, 2), one by one."""

    owners: IntArray  # index into the surfaces shown, shape (P,)
    sides: list[int]  # of the image
    corners: FloatArray
    starts: IntArray  # of each part in the corners, shape (P,)
    sizes: IntArray  # how many corners it has, shape (P,)


def sampling(scene: Scene, shown: IntArray, maps: FloatArray, parts: Parts) -> list[Strip]:
    """Choose how each part of a surface is sampled: for the mean over its corners."""
    owners, sides, corners, starts, sizes = parts
    if not len(owners):
        return []
    middles = np.add.reduceat(corners, starts) / sizes[:, None]
    corners = corners + (1.0 - SPREAD) * (np.repeat(middles, sizes, axis=0) - corners)
    slopes = _slopes(scene, shown, maps, np.repeat(owners, sizes), corners)
    across = slopes[:, 0, 0] * slopes[:, 1, 1] - slopes[:, 0, 1] * slopes[:, 1, 0]
    area = np.add.reduceat(np.abs(across), starts) / sizes
    slopes = np.sqrt(np.add.reduceat(slopes**2, starts) / sizes[:, None, None])
    columns, rows = _subdivisions(slopes, np.maximum(area, 1e-12))
    footprint = _footprint(slopes, columns, rows)
    copies = np.rint(2.0 * np.log2(np.maximum(footprint, 1.0))).astype(int)
    fields = (shown[owners], np.array(sides), *copies.T, columns, rows)
    return [Strip(*row) for row in np.stack(fields, axis=1).tolist()]


def _slopes(
    scene: Scene, shown: IntArray, maps: FloatArray, owners: IntArray, pixels: FloatArray
) -> FloatArray:
    """Return by how many texels along u, v one moves for a pixel in x, y; shape (K, 2, 2)."""
    maps, (x, y) = maps[owners], pixels.T[:, :, None]
    homogeneous = maps[:, :, 0] * x + maps[:, :, 1] * y + maps[:, :, 2]
    ab, w = homogeneous[:, :2] / homogeneous[:, 2:], homogeneous[:, 2]
    shapes = scene.texture_sizes[shown[owners]]
    shifts = maps[:, :2, :2] - ab[:, :, None] * maps[:, 2:, :2]
    return np.asarray(shifts * (shapes / w[:, None])[:, :, None])


def _footprint(slopes: FloatArray, columns: IntArray, rows: IntArray) -> FloatArray:
    """Return how many texels a part of a pixel spans along u and v, shape (..., K, 2)."""
    return np.asarray(
        np.hypot(slopes[:, :, 0] / columns[..., None], slopes[:, :, 1] / rows[..., None])
    )


def _subdivisions(slopes: FloatArray, area: FloatArray) -> tuple[IntArray, IntArray]:
    """
    Return into how many columns and rows pixels are cut before they are sampled.

    Texture copies are blurred along u and v. A pixel that is a skewed sliver on the texture would
    be blurred far beyond it; its parts are less skewed. Where copies could not be much sharper,
    because the texture is magnified, pixels stay whole.
    """
    columns, rows = SUBDIVISIONS.T[:, :, None]
    blurred = (
        np.maximum(_footprint(slopes, columns, rows), SHARPEST).prod(axis=-1) * columns * rows
    )
    skew = np.maximum(blurred, MAX_SKEW * np.maximum(area, SHARPEST**2))
    fewest = np.argmax(skew <= skew.min(axis=0) / WORTHWHILE, axis=0)
    return SUBDIVISIONS[fewest, 0], SUBDIVISIONS[fewest, 1]


NEAR = 0.05  # nothing nearer than this is seen [m]
MARGIN = 4.0  # how far outside of the image polygons are cut off [px]
SUBPIXEL_BITS = 6

Ids: TypeAlias = NDArray[np.uint8] | NDArray[np.uint16]
Box: TypeAlias = tuple[int, int, int, int]
Corner: TypeAlias = tuple[float, float, float]
Polygon: TypeAlias = list[Corner]
Plane: TypeAlias = tuple[float, float, float, float]
STRIP_RATIO = 1.4  # farthest over nearest depth within one strip
# Planes of x / z = -0.33 and 0.33, at which the strips of floor and ceiling are cut.
SECTIONS = ((1.0, 0.0, 0.33, 0.0), (1.0, 0.0, -0.33, 0.0))


@dataclass(frozen=True, eq=False)
class PinholeView:
    """An ideal pinhole somewhere in the world: image size, intrinsics [px], where it is."""

    width: int
    height: int
    intrinsics: FloatArray
    centre: FloatArray
    R_world_camera: FloatArray

    def to_camera(self, points: FloatArray) -> FloatArray:
        """Express world ``points``, shape (..., 3), in camera axes."""
        return np.asarray((points - self.centre) @ self.R_world_camera)

    @cached_property
    def scales(self) -> tuple[float, float, float, float]:
        """Focal lengths and principal point: fx, fy, cx, cy [px]."""
        k = self.intrinsics
        return float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])

    def frustum(self) -> list[Plane]:
        """Planes (a, b, c, d) with a x + b y + c z + d >= 0 for what may be seen."""
        fx, fy, cx, cy = self.scales
        return [
            (0.0, 0.0, 1.0, -NEAR),
            (fx, 0.0, cx + MARGIN, 0.0),
            (-fx, 0.0, self.width - 1 + MARGIN - cx, 0.0),
            (0.0, fy, cy + MARGIN, 0.0),
            (0.0, -fy, self.height - 1 + MARGIN - cy, 0.0),
        ]


@dataclass(frozen=True, eq=False)
class Raster:
    """The number of the strip seen at each pixel; 0 is none, strips[k - 1] is k."""

    ids: Ids
    strips: tuple[Strip, ...]
    boxes: tuple[Box, ...]  # of each strip: left, top, right, bottom, the last two exclusive [px]
    shown: IntArray  # surfaces that may be seen, shape (S,)
    maps: FloatArray  # their maps from pixels to (a w, b w, w) of origin + a u + b v, (S, 3, 3)


def rasterize(scene: Scene, view: PinholeView) -> Raster:
    """Paint the numbers of the strips of all surfaces from back to front."""
    shown, polygons = _polygons(scene, view)
    corners = view.to_camera(scene.corners[shown])
    edges = corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]
    frames = np.stack([*edges, corners[:, 0]], axis=-1)
    maps = np.asarray(np.linalg.inv(frames) @ np.linalg.inv(view.intrinsics))
    level = np.abs(scene.normals[shown, 2]) > 0.5
    parts = _parts(view, polygons, level.tolist())
    keys = sampling(scene, shown, maps, parts)
    numbers = {key: number for number, key in enumerate(dict.fromkeys(keys), start=1)}
    shape = (view.height, view.width)
    ids: Ids = np.zeros(shape, np.uint8) if len(numbers) < 256 else np.zeros(shape, np.uint16)
    vertices = np.rint(parts.corners * (1 << SUBPIXEL_BITS)).astype(np.int32)
    painted = [numbers[key] for key in keys]
    for number, start, size in zip(
        painted, parts.starts.tolist(), parts.sizes.tolist(), strict=True
    ):
        outline = vertices[start : start + size]
        cv2.fillConvexPoly(ids, outline, number, cv2.LINE_8, SUBPIXEL_BITS)
    boxes = _boxes(view, parts, np.array(painted, np.int64) - 1, len(numbers))
    return Raster(ids, tuple(numbers), boxes, shown, maps)


def _parts(view: PinholeView, polygons: list[Polygon], level: list[bool]) -> Parts:
    """Cut the polygons of surfaces, some of them ``level``, and project them."""
    owners, sides, sizes = [], [], []
    corners: Polygon = []
    for owner, polygon in enumerate(polygons):
        for side, strip in strips(polygon, sections=level[owner]):
            owners.append(owner)
            sides.append(side)
            sizes.append(len(strip))
            corners += strip
    fx, fy, cx, cy = view.scales
    x, y, z = np.array(corners).reshape(-1, 3).T
    pixels = np.stack([fx * x / z + cx, fy * y / z + cy], axis=1)
    counts = np.array(sizes, np.int64)
    return Parts(np.array(owners, np.int64), sides, pixels, np.cumsum(counts) - counts, counts)


def _polygons(scene: Scene, view: PinholeView) -> tuple[IntArray, list[Polygon]]:
    """Return surfaces in view, from back to front, and what of them is in view."""
    frustum = view.frustum()
    planes = np.array(frustum)
    corners = view.to_camera(scene.corners)
    inside = corners @ planes[:, :3].T + planes[:, 3] >= 0.0
    candidates = np.nonzero(scene.facing(view.centre) & inside.any(axis=1).all(axis=1))[0]
    rank = np.argsort(scene.back_to_front(view.centre))[scene.bodies]
    candidates = candidates[np.argsort(rank[candidates], kind='stable')]
    shown, polygons = [], []
    for k, place in zip(candidates.tolist(), corners[candidates].tolist(), strict=True):
        polygon: Polygon = list(map(tuple, place))
        for plane in frustum:
            polygon, _ = _split(polygon, plane)
        if polygon:
            shown.append(k)
            polygons.append(polygon)
    return np.array(shown, dtype=np.int64), polygons


def _boxes(view: PinholeView, parts: Parts, strips: IntArray, count: int) -> tuple[Box, ...]:
    """Return for each of ``count`` strips the pixels that its parts may touch."""
    if not count:
        return ()
    size = np.array([view.width, view.height])
    low = np.maximum(np.minimum.reduceat(parts.corners, parts.starts).astype(np.int64) - 2, 0)
    high = np.maximum.reduceat(parts.corners, parts.starts).astype(np.int64) + 3
    boxes = np.concatenate([np.tile(size, (count, 1)), np.zeros((count, 2), np.int64)], axis=1)
    np.minimum.at(boxes[:, :2], strips, low)
    np.maximum.at(boxes[:, 2:], strips, np.minimum(high, size))
    return tuple((left, top, right, bottom) for left, top, right, bottom in boxes.tolist())


def _split(polygon: Polygon, plane: Plane) -> tuple[Polygon, Polygon]:
    """Return what of a convex polygon is on the inner side of a plane, and on the outer one."""
    a, b, c, d = plane
    sides = [a * x + b * y + c * z + d for x, y, z in polygon]
    if min(sides, default=0.0) >= 0.0:
        return polygon, []
    if max(sides) < 0.0:
        return [], polygon
    inside: Polygon = []
    outside: Polygon = []
    before, side_before = polygon[-1], sides[-1]
    for point, side in zip(polygon, sides, strict=True):
        if (side >= 0.0) != (side_before >= 0.0):
            t = side_before / (side_before - side)
            (x0, y0, z0), (x1, y1, z1) = before, point
            corner = x0 + t * (x1 - x0), y0 + t * (y1 - y0), z0 + t * (z1 - z0)
            inside.append(corner)
            outside.append(corner)
        (inside if side >= 0.0 else outside).append(point)
        before, side_before = point, side
    return inside, outside


def strips(polygon: Polygon, *, sections: bool) -> Iterator[tuple[int, Polygon]]:
    """
    Cut a polygon at fixed depths, and across in ``sections`` if so wished.

    Yields with each part on which side of the image it is: -1, 0 in the middle, or 1.
    """
    depths = [z for _, _, z in polygon]
    first = math.floor(math.log(min(depths), STRIP_RATIO) + 1e-9)
    last = math.ceil(math.log(max(depths), STRIP_RATIO) - 1e-9)
    cuts = [(0.0, 0.0, 1.0, -(STRIP_RATIO**k)) for k in range(first + 1, last)]
    for strip in _slices(polygon, cuts):
        parts = _slices(strip, SECTIONS) if sections else [[], strip]
        yield from ((side, part) for side, part in enumerate(parts, start=-1) if len(part) > 2)


def _slices(polygon: Polygon, planes: Iterable[Plane]) -> Iterator[Polygon]:
    """Yield what of a polygon is outside of one plane after the other, then the rest."""
    for plane in planes:
        polygon, part = _split(polygon, plane)
        yield part
    yield polygon


FLAGS = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
REACH = 2  # pixels looked at on either side of an edge


def draw(scene: Scene, view: PinholeView) -> Image:
    """Return the image of ``scene`` by an ideal pinhole, shape (H, W)."""
    raster = rasterize(scene, view)
    image: Image = np.zeros((view.height, view.width), dtype=np.uint8)
    draw_textures(scene, raster, image)
    smooth_edges(scene, view, raster, image)
    return image


def draw_textures(scene: Scene, raster: Raster, image: Image) -> None:
    """Sample the textures of all strips into ``image``, shape (H, W)."""
    maps = dict(zip(raster.shown.tolist(), raster.maps, strict=True))
    for number, (strip, box) in enumerate(zip(raster.strips, raster.boxes, strict=True), start=1):
        left, top, right, bottom = box
        # Not cv2.compare: it takes the number for an array where the box is a single pixel.
        mask = np.equal(raster.ids[top:bottom, left:right], number).view(np.uint8)
        x, y, width, height = cv2.boundingRect(mask) if mask.size else (0, 0, 0, 0)
        if width == 0:
            continue
        left, top, mask = left + x, top + y, mask[y : y + height, x : x + width]
        sheet, matrix = _source(scene, strip, maps[strip.surface], (left, top))
        size = width * strip.columns, height * strip.rows
        parts = cv2.warpPerspective(sheet, matrix, size, None, FLAGS, cv2.BORDER_REPLICATE)
        if size != (width, height):  # their mean, a half is rounded to even
            parts = cv2.resize(parts, (width, height), interpolation=cv2.INTER_AREA)
        cv2.copyTo(parts, mask, image[top : top + height, left : left + width])


def _source(
    scene: Scene, strip: Strip, pixel_map: FloatArray, corner: tuple[int, int]
) -> tuple[Image, FloatArray]:
    """
    Return the sheet to sample for a strip, and the map to its texels, shape (3, 3).

    It is from parts of pixels, counted from the upper left ``corner``; ``pixel_map`` is that of
    the raster.
    """
    texture = scene.surfaces[strip.surface].texture
    sheet, i, j = texture.filtered(strip.p, strip.q)
    rows, columns = texture.image.shape
    # Texel t of the original is texel (t + 1/2) / 2^i - 1/2 of a copy halved i times.
    texels = np.diag([columns / 2**i, rows / 2**j, 1.0])
    texels[:2, 2] = -0.5
    # Part k of the n parts of pixel x is centred at x + (k + 1/2) / n - 1/2.
    parts = np.array([strip.columns, strip.rows])
    pixels = np.diag([*(1.0 / parts), 1.0])
    pixels[:2, 2] = corner + 0.5 / parts - 0.5
    return sheet, texels @ pixel_map @ pixels


def smooth_edges(scene: Scene, view: PinholeView, raster: Raster, image: Image) -> None:
    """
    Mix the pixels of ``image``, shape (H, W), that an edge cuts, by covered area.

    Where the edge of a surface crosses a pixel and the surface is seen on its inner side, the
    pixel takes as much of either side as the edge leaves it. Pixels that were painted although
    they lie wholly outside of the edge are taken from their neighbour.
    """
    pixels, inwards, shares, owners = find_crossings(scene, view, raster)
    ids, surfaces = raster.ids.ravel(), np.array([-1, *(strip.surface for strip in raster.strips)])

    def surface_at(pixels: IntArray) -> IntArray:
        return surfaces.take(ids.take(pixels))

    beside = surface_at(pixels - inwards)
    sticks = beside == owners
    cut = np.flatnonzero((surface_at(pixels + inwards) == owners) & ~sticks)
    at, step, owner = pixels[cut], inwards[cut], owners[cut]
    here = surface_at(at)
    inside = np.where(here == owner, at, at + step)
    outside = np.where(here == beside[cut], at, at - step)
    over = np.flatnonzero(sticks)
    over = over[surface_at(pixels[over]) == owners[over]]
    step, owner = inwards[over], owners[over]
    stuck = pixels[over] - step
    sources = stuck - step
    wrong = surface_at(sources) != owner
    flat = image.reshape(-1)
    # All is read before anything is written.
    within, beyond = flat.take(inside).astype(np.float64), flat.take(outside)
    taken = flat.take(sources[wrong])
    flat[at] = np.rint(beyond + shares[cut] * (within - beyond))
    flat[stuck[wrong]] = taken


def find_crossings(
    scene: Scene, view: PinholeView, raster: Raster
) -> tuple[IntArray, IntArray, FloatArray, IntArray]:
    """
    Walk along all edges of the surfaces in view: a pixel a row of a steep one, or one a column.

    Returns the pixels by their index in the flat image, the step to the next one across the edge,
    towards the surface, how much of the pixel the surface covers, and which surface it is.
    """
    ends, owners = _edges(scene, view, raster.shown)
    delta = ends[:, 1] - ends[:, 0]
    steep = np.abs(delta[:, 1]) > np.abs(delta[:, 0])
    # Corners go clockwise on screen, so the inside is to the right of an edge.
    inward = np.where(steep, -np.sign(delta[:, 1]), np.sign(delta[:, 0])).astype(np.int64)
    along, across = np.where(steep[:, None, None], ends[:, :, ::-1], ends).transpose(2, 0, 1)
    length = np.where(steep, view.height, view.width)
    first = np.maximum(np.ceil(along.min(axis=1)), 0.0).astype(np.int64)
    last = np.minimum(np.floor(along.max(axis=1)), length - 1.0).astype(np.int64)
    counts = np.maximum(last - first + 1, 0)
    slope = (across[:, 1] - across[:, 0]) / np.where(counts > 0, along[:, 1] - along[:, 0], 1.0)
    edge = np.repeat(np.arange(len(ends)), counts)
    position = np.arange(len(edge)) - (np.cumsum(counts) - counts - first)[edge]
    crossing = slope[edge] * position + (across[:, 0] - slope * along[:, 0])[edge]
    farthest = np.where(steep, view.width, view.height) - 1.0 - REACH
    inside = np.flatnonzero((crossing > REACH) & (crossing < farthest[edge]))
    edge, position, crossing = edge[inside], position[inside], crossing[inside]
    cell = np.rint(crossing).astype(np.int64)
    step, stride = np.where(steep, 1, view.width), np.where(steep, view.width, 1)
    pixels = cell * step[edge] + position * stride[edge]
    shares = 0.5 - (crossing - cell) * inward[edge]
    return pixels, (inward * step)[edge], shares, owners[edge]


def _edges(scene: Scene, view: PinholeView, shown: IntArray) -> tuple[FloatArray, IntArray]:
    """Return the ends of all edges ahead of the camera, shape (E, 2, 2) [px], and their owners."""
    corners = view.to_camera(scene.corners[shown])
    ends = np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2, 3)
    owners = np.repeat(shown, 4)
    ahead = ends[:, :, 2].max(axis=1) > NEAR
    ends, owners = ends[ahead], owners[ahead]
    depths = ends[:, :, 2]
    behind = np.nonzero(depths < NEAR)
    other = (behind[0], 1 - behind[1])
    share = (NEAR - depths[behind]) / (depths[other] - depths[behind])
    cut = ends[behind] + share[:, None] * (ends[other] - ends[behind])
    ends[behind] = cut
    fx, fy, cx, cy = view.scales
    return ends[..., :2] / ends[..., 2:] * [fx, fy] + [cx, cy], owners
