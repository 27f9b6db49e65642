"""Drawing of a raster: textures strip by strip, then edges, placed sub-pixel exactly."""

from typing import NamedTuple

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image, IntArray
from visual_servo_epipolar.simulation.rendering.raster import (
    NEAR,
    PinholeView,
    Raster,
    rasterize,
    Strip,
)
from visual_servo_epipolar.simulation.rendering.surfaces import Scene

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
        mean = _averaged(np.asarray(parts, np.uint8), strip)
        cv2.copyTo(mean, mask, image[top : top + height, left : left + width])


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


def _averaged(parts: Image, strip: Strip) -> Image:
    """Return the mean of the parts of each pixel; a half is rounded to even."""
    if strip.columns > 1:
        size = parts.shape[1] // strip.columns, len(parts) // strip.rows
        return np.asarray(cv2.resize(parts, size, interpolation=cv2.INTER_AREA), np.uint8)
    if strip.rows == 1:
        return parts
    total = np.zeros((len(parts) // strip.rows, parts.shape[1]), np.float32)
    for k in range(strip.rows):
        cv2.accumulate(parts[k :: strip.rows], total)
    return np.asarray(cv2.convertScaleAbs(total, alpha=1.0 / strip.rows), np.uint8)


class Crossings(NamedTuple):
    """Pixels crossed by edges of surfaces: one a row where an edge is steep, or one a column."""

    pixels: IntArray  # index into the flat image
    inwards: IntArray  # index step to the next pixel across the edge, towards the surface
    shares: FloatArray  # how much of the pixel the surface covers
    owners: IntArray  # the surface whose edge it is


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


def find_crossings(scene: Scene, view: PinholeView, raster: Raster) -> Crossings:
    """Walk along all edges of the surfaces in view."""
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
    # Whole numbers as floats: to convert some 20 000 of them takes as long as to add them.
    starts = np.cumsum(counts) - counts
    position = np.arange(float(counts.sum()))
    position -= np.repeat((starts - first).astype(np.float64), counts)
    crossing = np.repeat(slope, counts)
    crossing *= position
    crossing += np.repeat(across[:, 0] - slope * along[:, 0], counts)
    farthest = np.where(steep, view.width, view.height) - 1.0 - REACH
    inside = np.flatnonzero((crossing > REACH) & (crossing < np.repeat(farthest, counts)))
    edge = np.repeat(np.arange(len(ends)), counts).take(inside)
    position, crossing = position.take(inside), crossing.take(inside)
    cell = np.rint(crossing)
    crossing -= cell
    crossing *= inward.astype(np.float64).take(edge)
    step, stride = np.where(steep, 1, view.width), np.where(steep, view.width, 1)
    cell *= step.astype(np.float64).take(edge)
    position *= stride.astype(np.float64).take(edge)
    cell += position
    pixels = cell.astype(np.int64)
    return Crossings(pixels, (inward * step).take(edge), 0.5 - crossing, owners.take(edge))


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
