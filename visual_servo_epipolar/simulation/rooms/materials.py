"""Materials of rooms and fronts of furniture; lengths in m, grey in 0..255."""

from collections.abc import Callable
import math

import cv2
import numpy as np

from visual_servo_epipolar.simulation.rooms.building import Painting

LETTERS = 'ABCDEFGHKLMNPRSTUVWXYZaeioustnr0123456789'


def word(sheet: Painting, length: int) -> str:
    """Return random letters."""
    return ''.join(sheet.rng.choice(list(LETTERS), length))


def lettering(
    sheet: Painting, x: float, y: float, width: float, height: float, ink: float
) -> None:
    """Fill an area with a headline and paragraphs of text-like lines."""
    head = min(0.16 * height, 0.2 * width)
    sheet.text(word(sheet, max(2, int(width / head))), x, y + head, 0.8 * head, ink)
    line = max(0.018, 0.03 * height)
    row = y + 1.7 * head
    while row < y + height - line:
        at, end = x, x + width * sheet.uniform(0.6, 1.0)
        while at < end - line:
            length = line * sheet.uniform(0.6, 3.5)
            sheet.rect(
                at, row, min(length, end - at), 0.55 * line, ink + sheet.uniform(-20.0, 40.0)
            )
            at += length + 0.5 * line
        row += line * float(sheet.rng.choice([1.0, 1.0, 1.0, 1.9]))


def shapes(sheet: Painting, x: float, y: float, width: float, height: float) -> None:
    """Fill an area with discs, bars and polygons of all sizes: abstract art."""
    rng = sheet.rng
    sheet.rect(x, y, width, height, sheet.uniform(20.0, 240.0))
    for size in 0.45 * min(width, height) * 0.82 ** np.arange(22):
        room = np.array([width, height]) - 2 * size
        at = np.array([x, y]) + size + rng.uniform(0.0, 1.0, 2) * room
        corners = int(rng.integers(3, 8))
        turns = np.sort(rng.uniform(0.0, 2.0 * math.pi, corners))
        if rng.uniform() < 0.35:
            sheet.disc(float(at[0]), float(at[1]), float(size), sheet.uniform(20.0, 240.0))
        else:
            outline = at + size * np.stack([np.cos(turns), np.sin(turns)], axis=1)
            sheet.polygon(outline, sheet.uniform(20.0, 240.0))


def mosaic(sheet: Painting, x: float, y: float, width: float, height: float) -> None:
    """Fill an area with a checker whose fields are light and dark, but no two alike."""
    columns = int(sheet.rng.integers(4, 9))
    cell = width / columns
    for row in range(math.ceil(height / cell)):
        for column in range(columns):
            dark = sheet.rng.uniform() < 0.25 + 0.5 * ((row + column) % 2)
            grey = sheet.uniform(15.0, 90.0) if dark else sheet.uniform(150.0, 245.0)
            size = min(cell, y + height - (y + row * cell))
            sheet.rect(x + column * cell, y + row * cell, cell, size, grey)


def landscape(sheet: Painting, x: float, y: float, width: float, height: float) -> None:
    """Fill an area with a sky, a sun or moon, and ranges of hills getting darker."""
    rng, across = sheet.rng, np.linspace(0.0, 1.0, 60)
    for k, grey in enumerate(
        np.linspace(sheet.uniform(190.0, 240.0), sheet.uniform(130.0, 180.0), 8)
    ):
        sheet.rect(x, y + k * height / 8, width, height / 8, float(grey))
    radius = 0.1 * min(width, height)
    at = x + width * rng.uniform(0.2, 0.8), y + height * rng.uniform(0.15, 0.4)
    sheet.disc(*at, radius, 250.0)
    for k in range(4):
        octaves = (1, 2.3, 5, 11, 23)
        waves = [np.sin(2.0 * math.pi * (f * across + rng.uniform())) / f for f in octaves]
        crest = y + height * (0.45 + 0.13 * k + 0.09 * sum(waves))
        ridge = np.stack([x + across * width, np.clip(crest, y, y + height)], axis=1)
        corners = [(x + width, y + height), (x, y + height)]
        sheet.polygon(np.concatenate([ridge, corners]), 120.0 - 28.0 * k + sheet.uniform(-10, 10))


def poster(sheet: Painting, x: float, y: float, width: float, height: float) -> None:
    """Hang a framed picture: text, abstract art, a mosaic, or a landscape with its title."""
    sheet.pictures.append((x, y, width, height))
    sheet.rect(x + 0.012, y + 0.018, width + 0.012, height + 0.012, 70.0)  # its shadow
    sheet.rect(x, y, width, height, float(sheet.rng.choice([25.0, 60.0, 215.0])))
    line = sheet.uniform(0.015, 0.04)
    x, y, width, height = x + line, y + line, width - 2 * line, height - 2 * line
    sheet.rect(x, y, width, height, sheet.uniform(205.0, 245.0))
    rim = 0.06 * min(width, height)
    x, y, width, height = x + rim, y + rim, width - 2 * rim, height - 2 * rim
    kind = int(sheet.rng.integers(5))
    if kind == 0:
        lettering(sheet, x, y, width, height, 40.0)
    elif kind in (1, 2):
        shapes(sheet, x, y, width, height)
    elif kind == 3:
        mosaic(sheet, x, y, width, height)
    else:
        landscape(sheet, x, y, width, 0.75 * height)
        lettering(sheet, x, y + 0.8 * height, width, 0.2 * height, 40.0)


def window(sheet: Painting, x: float, y: float, width: float, height: float) -> None:
    """Put a window with a view of hills and houses, mullions, and a sill."""
    sheet.rect(x - 0.06, y - 0.06, width + 0.12, height + 0.12, 225.0)
    landscape(sheet, x, y, width, height)
    for _ in range(9):
        size = sheet.uniform(0.08, 0.3) * width / 2.0
        left = x + sheet.uniform(0.0, 1.0) * (width - size)
        tall = size * sheet.uniform(0.5, 1.6)
        sheet.rect(left, y + height - tall, size, tall, sheet.uniform(60.0, 200.0))
        for row in np.arange(y + height - 0.8 * tall, y + height, 0.09):
            for column in np.arange(left + 0.02, left + size - 0.04, 0.07):
                sheet.rect(column, row, 0.03, 0.045, sheet.uniform(20.0, 250.0))
    for share in (0.0, 0.5, 1.0):
        sheet.rect(x - 0.025 + share * width, y, 0.05, height, 232.0)
        sheet.rect(x - 0.008 + share * width, y, 0.01, height, 120.0)
    for share in (0.0, 0.36, 1.0):
        sheet.rect(x, y - 0.025 + share * height, width, 0.05, 228.0)
    sheet.rect(x - 0.12, y + height + 0.05, width + 0.24, 0.05, 240.0)
    sheet.rect(x - 0.12, y + height + 0.1, width + 0.24, 0.02, 110.0)


def door(sheet: Painting, x: float, width: float, height: float) -> None:
    """Put a door with panels, handle and sign, standing on the lower edge."""
    y, grey = sheet.height - height, sheet.uniform(85.0, 150.0)
    sheet.rect(x - 0.09, y - 0.09, width + 0.18, height + 0.09, grey - 45.0)
    sheet.rect(x, y, width, height, grey)
    panels = ((0.1, 0.08, 0.36), (0.54, 0.08, 0.36), (0.1, 0.55, 0.38), (0.54, 0.55, 0.38))
    for left, top, tall in panels:
        box = (x + left * width, y + top * height, 0.36 * width, tall * height)
        sheet.rect(*box, grey - 16.0)
        sheet.frame(*box, line=0.015, grey=grey + 28.0)
        sheet.line([(box[0], box[1]), (box[0] + box[2], box[1])], 0.01, grey - 55.0)
    sheet.rect(x + 0.88 * width, y + 0.5 * height, 0.05, 0.18, 210.0)
    sheet.disc(x + 0.88 * width + 0.025, y + 0.5 * height + 0.05, 0.03, 40.0)
    sheet.rect(x + 0.3 * width, y + 0.2 * height, 0.4 * width, 0.12, 235.0)
    sheet.text(word(sheet, 5), x + 0.33 * width, y + 0.2 * height + 0.09, 0.06, 30.0)


def books(sheet: Painting, x: float, y: float, width: float, height: float) -> None:
    """Stand books on a shelf whose board is at y + height; every book is its own."""
    rng, at = sheet.rng, x
    sheet.rect(x, y, width, height, 38.0)
    while at < x + width - 0.03:
        thick, tall = sheet.uniform(0.018, 0.06), height * sheet.uniform(0.6, 0.93)
        if rng.uniform() < 0.06:
            at += sheet.uniform(0.05, 0.2)
            continue
        thick = min(thick, x + width - at)
        _book(sheet, at, y + height - tall, thick, tall, sheet.uniform(35.0, 235.0))
        at += thick


def _book(sheet: Painting, x: float, y: float, thick: float, tall: float, grey: float) -> None:
    sheet.rect(x, y, thick, tall, grey - 40.0)
    sheet.rect(x + 0.003, y + 0.002, thick - 0.007, tall, grey)
    ink = grey - 110.0 if grey > 130.0 else grey + 110.0
    for band in sheet.rng.uniform(0.03, 0.95, int(sheet.rng.integers(1, 4))):
        sheet.rect(
            x + 0.003, y + band * tall, thick - 0.007, tall * sheet.uniform(0.01, 0.05), ink
        )
    if thick > 0.03:
        start, steps = y + 0.25 * tall, int(sheet.rng.integers(4, 9))
        for row in start + 0.06 * tall * np.arange(steps):
            sheet.rect(x + 0.3 * thick, row, sheet.uniform(0.2, 0.4) * thick, 0.03 * tall, ink)


CONTRAST, MEAN = 0.25, 150.0  # share of the contrast that is left of what is faded, its grey


def planks(sheet: Painting) -> None:
    """Lay wooden planks along y, each cut, toned and grained for itself."""
    sheet.fill(62.0)
    rng, density = sheet.rng, sheet.density
    wood = sheet.grain_patch((4 * 1024, 1024), (1.0, 12.0))  # along the grain
    x = 0.0
    while x < sheet.width:
        width, y = sheet.uniform(0.13, 0.21), -sheet.uniform(0.0, 1.5)
        while y < sheet.height:
            length = sheet.uniform(0.7, 2.2)
            rows, columns = int((length - 0.006) * density), int((width - 0.006) * density)
            down, right = rng.integers(0, (4096 - rows, 1024 - columns))
            part = wood[down : down + rows, right : right + columns]
            base, share = sheet.uniform(108.0, 158.0), sheet.uniform(0.35, 0.75)
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
            sheet.line(at + bends, 0.004, sheet.uniform(60.0, 220.0))
        else:
            radius = sheet.uniform(0.005, 0.025)
            turns = np.sort(rng.uniform(0.0, 2.0 * math.pi, 7))
            blot = at + radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
            sheet.polygon(blot, sheet.uniform(50.0, 120.0))


def rug(sheet: Painting, x: float, y: float, width: float, height: float) -> None:
    """Lay a rug with a border of triangles and a field of lozenges, none alike."""
    sheet.rect(x, y, width, height, 88.0)
    sheet.frame(x + 0.08, y + 0.08, width - 0.16, height - 0.16, line=0.05, grey=185.0)
    for ring, size in ((0.2, 0.13), (0.45, 0.24)):
        left, right, top, bottom = x + ring, x + width - ring, y + ring, y + height - ring
        for at in np.arange(left, right - 0.5 * size, 1.25 * size).tolist():
            _lozenge(sheet, at, top, size)
            _lozenge(sheet, at, bottom - size, size)
        for at in np.arange(top + 1.25 * size, bottom - 2.0 * size, 1.25 * size).tolist():
            _lozenge(sheet, left, at, size)
            _lozenge(sheet, right - size, at, size)
    for size in (0.6, 0.4, 0.22):
        _lozenge(sheet, x + (width - size) / 2.0, y + (height - size) / 2.0, size)


def _lozenge(sheet: Painting, x: float, y: float, size: float) -> None:
    for share in (1.0, 0.62, 0.3):
        half, cx, cy = 0.5 * size * share, x + 0.5 * size, y + 0.5 * size
        tip = half * sheet.uniform(0.8, 1.2)
        corners = [(cx - half, cy), (cx, cy - tip), (cx + half, cy), (cx, cy + tip)]
        sheet.polygon(corners, sheet.uniform(40.0, 225.0))


def ceiling(sheet: Painting, lamps: list[tuple[float, float]], *, plain: bool = False) -> None:
    """Hang panels of mineral fibre, each toned and pitted for itself, with vents and lamps."""
    rng, size = sheet.rng, 0.6
    sheet.fill(190.0)
    for x in np.arange(0.0, sheet.width, size):
        for y in np.arange(0.0, sheet.height, size):
            sheet.rect(
                x + 0.006, y + 0.006, size - 0.014, size - 0.014, sheet.uniform(184.0, 212.0)
            )
            marks = 0 if plain else int(rng.integers(0, 8))
            for cx, cy in rng.uniform(0.05, size - 0.05, (marks, 2)):
                radius = sheet.uniform(0.004, 0.02)
                sheet.disc(x + cx, y + cy, radius, sheet.uniform(80.0, 150.0))
            if not plain and rng.uniform() < 0.13:
                _fitting(sheet, x, y, size)
            joint = [(x, y), (x, y + size), (x + size, y + size)]
            sheet.line(joint, 0.012, sheet.uniform(105.0, 150.0))
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
            sheet.rect(x + 0.1, y + 0.1 + 0.058 * k, size - 0.2, 0.03, sheet.uniform(35.0, 80.0))
    elif kind == 1:
        for radius, grey in ((0.16, 235.0), (0.13, 90.0), (0.06, 180.0), (0.03, 40.0)):
            sheet.disc(x + 0.5 * size, y + 0.5 * size, radius, grey)
    else:
        for _ in range(5):
            dx, dy = sheet.rng.uniform(0.1, size - 0.1, 2)
            sheet.disc(x + dx, y + dy, sheet.uniform(0.02, 0.09), sheet.uniform(150, 185))


def wall(sheet: Painting, *, fittings: str = '', pictures: float = 0.0) -> None:
    """
    Paint a wall with skirting, cables and wear.

    Along it, from the left, stand ``fittings``: d a door, w a window, p pictures, a blank nothing;
    a word such as 'pwpd' is spread evenly. ``pictures`` more hang for each square metre.
    """
    sheet.fill(sheet.uniform(172.0, 192.0))
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
    middle = x + 0.5 * span
    if fitting == 'd':
        door(sheet, middle - 0.45, 0.9, 2.05)
        sheet.rect(middle + 0.62, sheet.height - 1.15, 0.08, 0.08, 240.0)
    elif fitting == 'w':
        width = min(1.7, 0.75 * span)
        window(sheet, middle - 0.5 * width, 0.5, width, 1.3)
    elif fitting == 'p':
        width = sheet.uniform(0.5, min(1.1, 0.7 * span))
        y, height = sheet.rng.uniform((0.35, 0.6), (0.7, 1.3)).tolist()
        poster(sheet, middle - 0.5 * width, y, width, height)
        sag = sheet.height - 0.3 + 0.1 * np.sin(np.linspace(0.0, math.pi, 12))
        sheet.line(np.stack([np.linspace(x, x + span, 12), sag], 1), 0.012, 50.0)
        sheet.rect(x + 0.1, sheet.height - 0.4, 0.09, 0.16, 235.0)
        sheet.disc(x + 0.145, sheet.height - 0.32, 0.025, 60.0)


def _gallery(sheet: Painting, pictures: float) -> None:
    """Hang pictures edge to edge and over each other all over the wall."""
    for _ in range(int(pictures * sheet.width * sheet.height)):
        width, height = sheet.rng.uniform(0.25, 1.0, 2)
        x = sheet.uniform(0.0, sheet.width - width)
        y = sheet.uniform(0.05, max(0.06, sheet.height - 0.2 - height))
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
        tall = min(sheet.uniform(0.27, 0.4), sheet.height - 0.08 - y)
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
            sheet.frame(*box, line=0.012, grey=sheet.uniform(25.0, 70.0))
            handle = x + width * sheet.uniform(0.35, 0.6), y + height * sheet.uniform(0.12, 0.3)
            sheet.rect(handle[0], handle[1], 0.12, 0.03, 225.0)
            sheet.rect(handle[0], handle[1] + 0.03, 0.12, 0.015, 25.0)
            if sheet.rng.uniform() < 0.6:
                left, top = (
                    x + width * sheet.uniform(0.1, 0.4),
                    y + height * sheet.uniform(0.4, 0.6),
                )
                sheet.rect(left, top, 0.4 * width, 0.3 * height, sheet.uniform(190.0, 240.0))
                lettering(sheet, left + 0.02, top + 0.02, 0.36 * width, 0.26 * height, 40.0)
    wear(sheet, 4.0)


def crate(sheet: Painting, grey: float) -> None:
    """Nail a crate of slats, with stencilled letters and stickers."""
    sheet.fill(40.0)
    slat = sheet.uniform(0.09, 0.15)
    for y in np.arange(0.0, sheet.height, slat):
        wood = grey + sheet.uniform(-35.0, 35.0)
        sheet.rect(0.0, float(y) + 0.004, sheet.width, slat - 0.01, wood)
    sheet.roughen(13.0, zoom=(8.0, 1.0))
    sheet.frame(0.0, 0.0, sheet.width, sheet.height, line=0.06, grey=grey - 35.0)
    for _ in range(int(3 + 7 * sheet.width * sheet.height)):
        size = sheet.uniform(0.12, 0.4) * min(sheet.width, sheet.height)
        at = sheet.rng.uniform((0.0, 0.0), (sheet.width - size, sheet.height - size))
        sheet.rect(at[0], at[1], size, 0.8 * size, sheet.uniform(170.0, 240.0))
        lettering(sheet, at[0] + 0.1 * size, at[1] + 0.1 * size, 0.8 * size, 0.6 * size, 30.0)
    sheet.roughen(4.0)


def noticeboard(sheet: Painting, grey: float) -> None:
    """Pin posters of all sizes all over a board."""
    sheet.fill(grey)
    sheet.roughen(12.0)
    for share in (0.55, 0.45, 0.4, 0.33, 0.3, 0.26, 0.22, 0.2, 0.18, 0.16):
        side = share * min(max(sheet.width, sheet.height), 1.7)
        size = np.minimum(sheet.rng.uniform(0.7, 1.2, 2) * side, (sheet.width, sheet.height))
        at = sheet.rng.uniform((0.0, 0.0), (sheet.width, sheet.height) - size)
        poster(sheet, *at.tolist(), *(0.95 * size).tolist())
    sheet.frame(0.0, 0.0, sheet.width, sheet.height, line=0.03, grey=60.0)
    sheet.roughen(3.0)


FRONTS = (bookcase, cupboard, crate, noticeboard)  # of furniture along walls


def pillar(sheet: Painting, grey: float) -> None:
    """Cast a concrete pillar and stick a few notices to it."""
    sheet.fill(grey)
    sheet.roughen(14.0, zoom=(3.0, 3.0))
    sheet.roughen(8.0)
    wear(sheet, 12.0)
    for y in np.arange(0.25, sheet.height - 0.5, 0.45):
        if sheet.rng.uniform() < 0.75:
            width = sheet.width * sheet.uniform(0.5, 0.85)
            x = (sheet.width - width) * sheet.uniform(0.1, 0.9)
            poster(sheet, x, float(y), width, sheet.uniform(0.2, 0.4))


def smooth(sheet: Painting, grey: float) -> None:
    """Paint a side without a mark."""
    sheet.fill(grey)
    sheet.roughen(2.0)


def faded(paint: Callable[..., None]) -> Callable[..., None]:
    """Return the painter that leaves CONTRAST of what ``paint`` paints."""

    def painter(sheet: Painting, **grey: float) -> None:
        paint(sheet, **grey)
        offset = (1.0 - CONTRAST) * MEAN
        sheet.pixels = np.asarray(cv2.convertScaleAbs(sheet.pixels, alpha=CONTRAST, beta=offset))

    return painter
