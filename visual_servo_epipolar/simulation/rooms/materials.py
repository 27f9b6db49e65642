"""Materials of rooms and fronts of furniture; lengths in m, grey in 0..255."""

from collections.abc import Callable
import math

import cv2
import numpy as np

from visual_servo_epipolar.simulation.rooms.pictures import (
    books,
    door,
    lettering,
    poster,
    tone,
    window,
)
from visual_servo_epipolar.simulation.rooms.textures import Painting

WOOD_LENGTH = 12.0  # wood is stretched so much along the grain
CONTRAST, MEAN = 0.25, 150.0  # share of the contrast that is left of what is faded, its grey


def planks(sheet: Painting) -> None:
    """Lay wooden planks along y, each cut, toned and grained for itself."""
    sheet.fill(62.0)
    rng, density = sheet.rng, sheet.density
    wood = sheet.grain_patch((4 * 1024, 1024), (1.0, WOOD_LENGTH))
    x = 0.0
    while x < sheet.width:
        width, y = float(rng.uniform(0.13, 0.21)), -float(rng.uniform(0.0, 1.5))
        while y < sheet.height:
            length = float(rng.uniform(0.7, 2.2))
            rows, columns = int((length - 0.006) * density), int((width - 0.006) * density)
            down, right = rng.integers(0, (4096 - rows, 1024 - columns))
            part = wood[down : down + rows, right : right + columns]
            base, share = tone(sheet, 108.0, 158.0), float(rng.uniform(0.35, 0.75))
            sheet.paste(cv2.addWeighted(part, share, part, 0.0, base - 128.0 * share), x, y)
            y += length
        x += width
    wear(sheet, 1.6)
    sheet.roughen(6.0, zoom=(1.0, 3.0))
    sheet.roughen(5.0)


def concrete(sheet: Painting) -> None:
    """Pour a floor with next to no texture."""
    sheet.fill(128.0)
    sheet.roughen(3.0, zoom=(6.0, 6.0))
    sheet.roughen(2.0)


def wear(sheet: Painting, amount: float) -> None:
    """Scratch and stain the sheet, ``amount`` marks a square metre."""
    rng = sheet.rng
    for _ in range(int(amount * sheet.width * sheet.height)):
        at = rng.uniform((0.0, 0.0), (sheet.width, sheet.height))
        if rng.uniform() < 0.6:
            bends = np.cumsum(rng.normal(0.0, 0.05, (4, 2)), axis=0)
            sheet.line(at + bends, 0.004, tone(sheet, 60.0, 220.0))
        else:
            radius = float(rng.uniform(0.005, 0.025))
            turns = np.sort(rng.uniform(0.0, 2.0 * math.pi, 7))
            blot = at + radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
            sheet.polygon(blot, tone(sheet, 50.0, 120.0))


def rug(sheet: Painting, x: float, y: float, width: float, height: float) -> None:
    """Lay a rug with a border of triangles and a field of lozenges, none alike."""
    sheet.rect(x, y, width, height, 88.0)
    sheet.frame(x + 0.08, y + 0.08, width - 0.16, height - 0.16, line=0.05, grey=185.0)
    for ring, size in ((0.2, 0.13), (0.45, 0.24)):
        for at_x in np.arange(x + ring, x + width - ring - 0.5 * size, 1.25 * size):
            for at_y in (y + ring, y + height - ring - size):
                _lozenge(sheet, float(at_x), at_y, size)
        for at_y in np.arange(y + ring + 1.25 * size, y + height - ring - 2.0 * size, 1.25 * size):
            for at_x in (x + ring, x + width - ring - size):
                _lozenge(sheet, at_x, float(at_y), size)
    for size in (0.6, 0.4, 0.22):
        _lozenge(sheet, x + (width - size) / 2.0, y + (height - size) / 2.0, size)


def _lozenge(sheet: Painting, x: float, y: float, size: float) -> None:
    for share in (1.0, 0.62, 0.3):
        half, cx, cy = 0.5 * size * share, x + 0.5 * size, y + 0.5 * size
        tip = half * tone(sheet, 0.8, 1.2)
        corners = [(cx - half, cy), (cx, cy - tip), (cx + half, cy), (cx, cy + tip)]
        sheet.polygon(corners, tone(sheet, 40.0, 225.0))


def ceiling(sheet: Painting, lamps: list[tuple[float, float]], *, plain: bool = False) -> None:
    """Hang panels of mineral fibre, each toned and pitted for itself, with vents and lamps."""
    rng, size = sheet.rng, 0.6
    sheet.fill(190.0)
    for x in np.arange(0.0, sheet.width, size):
        for y in np.arange(0.0, sheet.height, size):
            sheet.rect(x + 0.006, y + 0.006, size - 0.014, size - 0.014, tone(sheet, 184.0, 212.0))
            marks = 0 if plain else int(rng.integers(0, 8))
            for cx, cy in rng.uniform(0.05, size - 0.05, (marks, 2)):
                sheet.disc(
                    x + cx, y + cy, float(rng.uniform(0.004, 0.02)), tone(sheet, 80.0, 150.0)
                )
            if not plain and rng.uniform() < 0.13:
                _fitting(sheet, x, y, size)
            sheet.line(
                [(x, y), (x, y + size), (x + size, y + size)], 0.012, tone(sheet, 105.0, 150.0)
            )
    for x, y in lamps:
        sheet.rect(x - 0.64, y - 0.19, 1.28, 0.38, 120.0)
        sheet.rect(x - 0.6, y - 0.15, 1.2, 0.3, 250.0)
        sheet.line([(x - 0.6, y), (x + 0.6, y)], 0.02, 190.0)
    sheet.roughen(3.0 if plain else 6.0)


def _fitting(sheet: Painting, x: float, y: float, size: float) -> None:
    """Build a vent, a loudspeaker, or a stain into a ceiling panel."""
    kind = int(sheet.rng.integers(3))
    if kind == 0:
        sheet.rect(x + 0.08, y + 0.08, size - 0.16, size - 0.16, 150.0)
        for k in range(7):
            sheet.rect(x + 0.1, y + 0.1 + 0.058 * k, size - 0.2, 0.03, tone(sheet, 35.0, 80.0))
    elif kind == 1:
        for radius, grey in ((0.16, 235.0), (0.13, 90.0), (0.06, 180.0), (0.03, 40.0)):
            sheet.disc(x + 0.5 * size, y + 0.5 * size, radius, grey)
    else:
        for _ in range(5):
            at = sheet.rng.uniform(0.1, size - 0.1, 2)
            sheet.disc(
                x + at[0], y + at[1], float(sheet.rng.uniform(0.02, 0.09)), tone(sheet, 150, 185)
            )


def wall(sheet: Painting, *, fittings: str = '', pictures: float = 0.0) -> None:
    """
    Paint a wall with skirting, cables and wear.

    Along it, from the left, stand ``fittings``: d a door, w a window, p pictures, a blank nothing;
    a word such as 'pwpd' is spread evenly. ``pictures`` more hang for each square metre.
    """
    sheet.fill(tone(sheet, 172.0, 192.0))
    sheet.roughen(5.0, zoom=(7.0, 7.0))
    sheet.roughen(4.5)
    wear(sheet, 0.5)
    span = sheet.width / max(len(fittings), 1)
    for k, fitting in enumerate(fittings):
        _fit(sheet, fitting, k * span, span)
    if pictures > 0.0:
        _gallery(sheet, pictures)
    sheet.rect(0.0, sheet.height - 0.11, sheet.width, 0.11, 92.0)
    sheet.rect(0.0, sheet.height - 0.115, sheet.width, 0.015, 150.0)


def _fit(sheet: Painting, fitting: str, x: float, span: float) -> None:
    middle, rng = x + 0.5 * span, sheet.rng
    if fitting == 'd':
        door(sheet, middle - 0.45, 0.9, 2.05)
        sheet.rect(middle + 0.62, sheet.height - 1.15, 0.08, 0.08, 240.0)
    elif fitting == 'w':
        width = min(1.7, 0.75 * span)
        window(sheet, middle - 0.5 * width, 0.5, width, 1.3)
    elif fitting == 'p':
        width = float(rng.uniform(0.5, min(1.1, 0.7 * span)))
        poster(
            sheet,
            middle - 0.5 * width,
            float(rng.uniform(0.35, 0.7)),
            width,
            tone(sheet, 0.6, 1.3),
        )
        sag = sheet.height - 0.3 + 0.1 * np.sin(np.linspace(0.0, math.pi, 12))
        sheet.line(np.stack([np.linspace(x, x + span, 12), sag], 1), 0.012, 50.0)
        sheet.rect(x + 0.1, sheet.height - 0.4, 0.09, 0.16, 235.0)
        sheet.disc(x + 0.145, sheet.height - 0.32, 0.025, 60.0)


def _gallery(sheet: Painting, pictures: float) -> None:
    """Hang pictures edge to edge and over each other all over the wall."""
    for _ in range(int(pictures * sheet.width * sheet.height)):
        width, height = sheet.rng.uniform(0.25, 1.0, 2)
        x = float(sheet.rng.uniform(0.0, sheet.width - width))
        y = float(sheet.rng.uniform(0.05, max(0.06, sheet.height - 0.2 - height)))
        poster(sheet, x, y, float(width), float(height))


def timber(sheet: Painting, grey: float) -> None:
    """Veneer a sheet with wood that runs along its longer side."""
    sheet.fill(grey)
    along_x = sheet.width > sheet.height
    sheet.roughen(13.0, zoom=(9.0, 1.0) if along_x else (1.0, 9.0))
    sheet.roughen(4.0)
    sheet.frame(0.0, 0.0, sheet.width, sheet.height, line=0.012, grey=grey - 30.0)


def bookcase(sheet: Painting, grey: float) -> None:
    """Fill the front of a case with rows of books."""
    timber(sheet, grey)
    y, board = 0.05, 0.035
    while y < sheet.height - 0.25:
        tall = min(float(sheet.rng.uniform(0.27, 0.4)), sheet.height - 0.08 - y)
        books(sheet, 0.04, y, sheet.width - 0.08, tall)
        y += tall + board
    sheet.roughen(3.0)


def cupboard(sheet: Painting, grey: float) -> None:
    """Close the front with doors and drawers that carry handles and labels."""
    timber(sheet, grey)
    columns = max(1, round(sheet.width / 0.55))
    rows = max(1, round(sheet.height / 0.45))
    width, height = sheet.width / columns, sheet.height / rows
    for x in width * np.arange(columns):
        for y in height * np.arange(rows):
            box = (x + 0.015, y + 0.015, width - 0.03, height - 0.03)
            sheet.frame(*box, line=0.012, grey=tone(sheet, 25.0, 70.0))
            handle = x + width * tone(sheet, 0.35, 0.6), y + height * tone(sheet, 0.12, 0.3)
            sheet.rect(handle[0], handle[1], 0.12, 0.03, 225.0)
            sheet.rect(handle[0], handle[1] + 0.03, 0.12, 0.015, 25.0)
            if sheet.rng.uniform() < 0.6:
                left, top = x + width * tone(sheet, 0.1, 0.4), y + height * tone(sheet, 0.4, 0.6)
                sheet.rect(left, top, 0.4 * width, 0.3 * height, tone(sheet, 190.0, 240.0))
                lettering(sheet, left + 0.02, top + 0.02, 0.36 * width, 0.26 * height, 40.0)
    wear(sheet, 4.0)


def crate(sheet: Painting, grey: float) -> None:
    """Nail a crate of slats, with stencilled letters and stickers."""
    sheet.fill(40.0)
    slat = float(sheet.rng.uniform(0.09, 0.15))
    for y in np.arange(0.0, sheet.height, slat):
        sheet.rect(
            0.0, float(y) + 0.004, sheet.width, slat - 0.01, grey + tone(sheet, -35.0, 35.0)
        )
    sheet.roughen(13.0, zoom=(8.0, 1.0))
    sheet.frame(0.0, 0.0, sheet.width, sheet.height, line=0.06, grey=grey - 35.0)
    for _ in range(int(3 + 7 * sheet.width * sheet.height)):
        size = float(sheet.rng.uniform(0.12, 0.4)) * min(sheet.width, sheet.height)
        at = sheet.rng.uniform((0.0, 0.0), (sheet.width - size, sheet.height - size))
        sheet.rect(at[0], at[1], size, 0.8 * size, tone(sheet, 170.0, 240.0))
        lettering(sheet, at[0] + 0.1 * size, at[1] + 0.1 * size, 0.8 * size, 0.6 * size, 30.0)
    sheet.roughen(4.0)


def noticeboard(sheet: Painting, grey: float) -> None:
    """Pin posters of all sizes all over a board."""
    sheet.fill(grey)
    sheet.roughen(12.0)
    for size in (0.55, 0.45, 0.4, 0.33, 0.3, 0.26, 0.22, 0.2, 0.18, 0.16):
        side = size * min(max(sheet.width, sheet.height), 1.7)
        width, height = np.minimum(
            sheet.rng.uniform(0.7, 1.2, 2) * side, (sheet.width, sheet.height)
        )
        at = sheet.rng.uniform((0.0, 0.0), (sheet.width - width, sheet.height - height))
        poster(sheet, float(at[0]), float(at[1]), 0.95 * float(width), 0.95 * float(height))
    sheet.frame(0.0, 0.0, sheet.width, sheet.height, line=0.03, grey=60.0)
    sheet.roughen(3.0)


def pillar(sheet: Painting, grey: float) -> None:
    """Cast a concrete pillar and stick a few notices to it."""
    sheet.fill(grey)
    sheet.roughen(14.0, zoom=(3.0, 3.0))
    sheet.roughen(8.0)
    wear(sheet, 12.0)
    for y in np.arange(0.25, sheet.height - 0.5, 0.45):
        if sheet.rng.uniform() < 0.75:
            width = sheet.width * tone(sheet, 0.5, 0.85)
            x = (sheet.width - width) * tone(sheet, 0.1, 0.9)
            poster(sheet, x, float(y), width, tone(sheet, 0.2, 0.4))


def smooth(sheet: Painting, grey: float) -> None:
    """Paint a side without a mark."""
    sheet.fill(grey)
    sheet.roughen(2.0)


def faded(paint: Callable[..., None]) -> Callable[..., None]:
    """Return the painter that leaves CONTRAST of what ``paint`` paints."""

    def painter(sheet: Painting, *grey: float) -> None:
        paint(sheet, *grey)
        offset = (1.0 - CONTRAST) * MEAN
        sheet.pixels = np.asarray(cv2.convertScaleAbs(sheet.pixels, alpha=CONTRAST, beta=offset))

    return painter
