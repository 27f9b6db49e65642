"""Edges between surfaces, placed sub-pixel exactly after the surfaces have been painted."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image, IntArray
from visual_servo_epipolar.simulation.rendering.raster import NEAR, PinholeView, Raster
from visual_servo_epipolar.simulation.rendering.surfaces import Scene

REACH = 2  # pixels looked at on either side of an edge


class Crossings(NamedTuple):
    """Pixels crossed by edges of surfaces: one a row where an edge is steep, or one a column."""

    pixels: IntArray  # index into the flat image
    inwards: IntArray  # index step to the next pixel across the edge, towards the surface
    shares: FloatArray  # how much of the pixel the surface covers
    owners: IntArray  # the surface whose edge it is


class Mixing(NamedTuple):
    """What is mixed where, by indices into the flat image: all that the image does not decide."""

    cut: IntArray  # pixels that an edge cuts
    inside: IntArray  # where the surface is seen beside each of them, shape as ``cut``
    outside: IntArray  # where what is behind it is seen, shape as ``cut``
    shares: FloatArray  # how much of each the surface covers, shape as ``cut``
    stuck: IntArray  # pixels painted although they lie wholly outside of an edge
    sources: IntArray  # the neighbours that these are taken from
    slivers: 'Slivers | None'


class Slivers(NamedTuple):
    """Pixels in which both edges of a thin surface lie, and what they are mixed from."""

    pixels: IntArray
    places: tuple[IntArray, IntArray, IntArray]  # where left, right and the surface are seen
    shares: tuple[FloatArray, FloatArray, FloatArray]  # how much of each a pixel takes


def mixing(scene: Scene, view: PinholeView, raster: Raster) -> Mixing:
    """
    Choose the pixels that an edge cuts, and from what to mix them.

    Where the edge of a surface crosses a pixel and the surface is seen on its inner side, the
    pixel takes as much of either side as the edge leaves it. Pixels that were painted although
    they lie wholly outside of the edge are taken from their neighbour.
    """
    crossings = find_crossings(scene, view, raster)
    pixels, inwards, shares, owners = crossings
    surface_at = _surfaces(raster)
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
    slivers = None
    if raster.thin.any():
        slivers = _slivers(crossings, surface_at, raster.shown[raster.thin])
    return Mixing(at, inside, outside, shares[cut], stuck[wrong], sources[wrong], slivers)


def smooth_edges(image: Image, mixing: Mixing) -> None:
    """Mix the pixels of ``image``, shape (H, W), that an edge cuts, by covered area."""
    flat = image.reshape(-1)
    inside = flat.take(mixing.inside).astype(np.float64)
    outside = flat.take(mixing.outside)
    taken = flat.take(mixing.sources)
    slivers = _mix(flat, mixing.slivers) if mixing.slivers else None
    # All is read before anything is written.
    flat[mixing.cut] = np.rint(outside + mixing.shares * (inside - outside))
    flat[mixing.stuck] = taken
    if slivers is not None:
        flat[slivers[0]] = slivers[1]


def _surfaces(raster: Raster) -> Callable[[IntArray], IntArray]:
    """Return what gives the surface seen at pixels, by their index into the flat image."""
    ids, surfaces = raster.ids.ravel(), np.array([-1, *(strip.surface for strip in raster.strips)])
    return lambda pixels: surfaces.take(ids.take(pixels))


def _slivers(
    crossings: Crossings, surface_at: Callable[[IntArray], IntArray], thin: IntArray
) -> Slivers:
    """Return where both edges of one of the surfaces ``thin`` lie in a pixel."""
    is_thin = np.zeros(int(crossings.owners.max(initial=0)) + 1, bool)
    is_thin[thin[thin < len(is_thin)]] = True
    keep = np.flatnonzero(is_thin.take(crossings.owners))
    pixels, inwards, shares, owners = (values[keep] for values in crossings)
    reach, count = int(np.abs(inwards).max(initial=0)), int(pixels.max(initial=0)) + 1
    # By owner, pixel and inwards: one key is sorted in half the time of three.
    key = (owners * count + pixels) * (2 * reach + 1) + (inwards + reach)
    order = np.argsort(key, kind='stable')
    one, two = order[:-1], order[1:]
    pairs = (pixels[one] == pixels[two]) & (owners[one] == owners[two])
    pairs &= inwards[one] == -inwards[two]
    one, two = one[pairs], two[pairs]
    at, step, owner = pixels[one], inwards[two], owners[one]
    # Edge one has the surface before it, edge two after it: one covers the rest from the far side.
    before, after = 1.0 - shares[two], 1.0 - shares[one]
    inside = np.full(len(at), -1)
    for place in (at - step, at + step, at):
        inside = np.where(surface_at(place) == owner, place, inside)
    left = np.where(surface_at(at - step) == owner, at - 2 * step, at - step)
    right = np.where(surface_at(at + step) == owner, at + 2 * step, at + step)
    valid = (inside >= 0) & (before + after <= 1.0)
    rest = (1.0 - before - after)[valid]
    places = left[valid], right[valid], inside[valid]
    return Slivers(at[valid], places, (before[valid], after[valid], rest))


def _mix(flat: Image, slivers: Slivers) -> tuple[IntArray, FloatArray]:
    """Return the pixels of slivers, and their grey values from the flat image."""
    left, right, inside = (flat.take(places) for places in slivers.places)
    before, after, rest = slivers.shares
    return slivers.pixels, np.rint(before * left + after * right + rest * inside)


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
