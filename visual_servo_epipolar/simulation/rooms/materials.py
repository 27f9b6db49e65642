"""Materials of rooms and fronts of furniture; lengths in m, grey in 0..255."""

from collections.abc import Callable
import math

import cv2
import numpy as np

from visual_servo_epipolar.simulation.rooms.building import Painting

LETTERS = 'ABCDEFGHKLMNPRSTUVWXYZaeioustnr0123456789'


def lettering(sheet: Painting, x: float, y: float, width: float, height: float) -> None:
    """Fill an area with a headline and paragraphs of text-like lines."""
    head = min(0.16 * height, 0.2 * width)
    words = ''.join(sheet.rng.choice(list(LETTERS), max(2, int(width / head))))
    sheet.text(words, x, y + head, 0.8 * head, 35.0)
    line = max(0.018, 0.03 * height)
    row = y + 1.7 * head
    while row < y + height - line:
        at, end = x, x + width * sheet.uniform(0.6, 1.0)
        while at < end - line:
            length = line * sheet.uniform(0.6, 3.5)
            grey = sheet.uniform(15.0, 75.0)
            sheet.rect(at, row, min(length, end - at), 0.55 * line, grey)
            at += length + 0.5 * line
        row += line * float(sheet.rng.choice([1.0, 1.0, 1.0, 1.9]))


def label(sheet: Painting, x: float, y: float, width: float, height: float) -> None:
    """Stick a printed label on."""
    sheet.rect(x, y, width, height, sheet.uniform(180.0, 240.0))
    lettering(sheet, x + 0.1 * width, y + 0.1 * height, 0.8 * width, 0.8 * height)


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


def poster(sheet: Painting, x: float, y: float, width: float, height: float) -> None:
    """Hang a framed picture: text, abstract art, or a mosaic."""
    sheet.pictures.append((x, y, width, height))
    sheet.rect(x + 0.012, y + 0.018, width + 0.012, height + 0.012, 70.0)  # its shadow
    sheet.rect(x, y, width, height, float(sheet.rng.choice([25.0, 60.0, 215.0])))
    line = sheet.uniform(0.015, 0.04)
    x, y, width, height = x + line, y + line, width - 2 * line, height - 2 * line
    sheet.rect(x, y, width, height, sheet.uniform(205.0, 245.0))
    rim = 0.06 * min(width, height)
    x, y, width, height = x + rim, y + rim, width - 2 * rim, height - 2 * rim
    (lettering, shapes, shapes, mosaic)[int(sheet.rng.integers(4))](sheet, x, y, width, height)


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
    sheet.rect(x + 0.88 * width, y + 0.5 * height, 0.05, 0.18, 210.0)
    sheet.disc(x + 0.88 * width + 0.025, y + 0.5 * height + 0.05, 0.03, 40.0)
    label(sheet, x + 0.3 * width, y + 0.2 * height, 0.4 * width, 0.15)


CONTRAST, MEAN = 0.25, 150.0  # share of the contrast that is left of what is faded, its grey


def planks(sheet: Painting) -> None:
    """Lay wooden planks along y, each cut and toned for itself, grained and worn."""
    sheet.fill(62.0)
    for x in np.arange(0.0, sheet.width, 0.17):
        y = -sheet.uniform(0.0, 1.5)
        while y < sheet.height:
            length = sheet.uniform(0.7, 2.2)
            sheet.rect(x, y, 0.164, length - 0.006, sheet.uniform(100.0, 165.0))
            y += length
    sheet.roughen(16.0, zoom=(1.0, 12.0))
    sheet.roughen(6.0, zoom=(1.0, 3.0))
    wear(sheet, 16.0)
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
        bends = np.cumsum(rng.normal(0.0, 0.05, (4, 2)), axis=0)
        at = rng.uniform((0.0, 0.0), (sheet.width, sheet.height))
        sheet.line(at + bends, float(rng.choice((0.004, 0.02))), sheet.uniform(50.0, 220.0))


def ceiling(sheet: Painting, lamps: list[tuple[float, float]]) -> None:
    """Hang panels of mineral fibre, each toned and pitted for itself, and lamps."""
    rng, size = sheet.rng, 0.6
    sheet.fill(190.0)
    for x in np.arange(0.0, sheet.width, size):
        for y in np.arange(0.0, sheet.height, size):
            sheet.rect(x, y, size, size, sheet.uniform(184.0, 212.0))
            for cx, cy in rng.uniform(0.05, size - 0.05, (int(rng.integers(0, 9)), 2)):
                radius = float(rng.choice((0.008, 0.016, 0.05)))
                sheet.disc(x + cx, y + cy, radius, sheet.uniform(80.0, 160.0))
            joint = [(x, y), (x, y + size), (x + size, y + size)]
            sheet.line(joint, 0.012, sheet.uniform(105.0, 150.0))
    for x, y in lamps:
        sheet.rect(x - 0.64, y - 0.19, 1.28, 0.38, 120.0)
        sheet.rect(x - 0.6, y - 0.15, 1.2, 0.3, 250.0)
    sheet.roughen(6.0)


def plaster(sheet: Painting, lamps: list[tuple[float, float]]) -> None:
    """Leave a ceiling without a mark."""
    sheet.fill(205.0)
    sheet.roughen(2.0, zoom=(7.0, 7.0))


def wall(sheet: Painting, fittings: str = '') -> None:
    """
    Paint a wall with skirting, cables and wear.

    Along it, from the left, stand ``fittings``, spread evenly: d a door, p pictures, b blank
    nothing, g a gallery of pictures edge to edge and over each other.
    """
    sheet.fill(sheet.uniform(172.0, 192.0))
    sheet.roughen(5.0, zoom=(7.0, 7.0))
    sheet.roughen(4.5)
    wear(sheet, 0.5)
    span = sheet.width / max(len(fittings), 1)
    for k, fitting in enumerate(fittings):
        _fit(sheet, fitting, k * span, span)
    sheet.rect(0.0, sheet.height - 0.11, sheet.width, 0.11, 92.0)
    sheet.rect(0.0, sheet.height - 0.115, sheet.width, 0.015, 150.0)


def _fit(sheet: Painting, fitting: str, x: float, span: float) -> None:
    middle = x + 0.5 * span
    if fitting == 'd':
        door(sheet, middle - 0.45, 0.9, 2.05)
    elif fitting == 'p':
        width = sheet.uniform(0.5, min(1.1, 0.7 * span))
        y, height = sheet.rng.uniform((0.35, 0.6), (0.7, 1.3)).tolist()
        poster(sheet, middle - 0.5 * width, y, width, height)
        sag = sheet.height - 0.3 + 0.1 * np.sin(np.linspace(0.0, math.pi, 12))
        sheet.line(np.stack([np.linspace(x, x + span, 12), sag], 1), 0.012, 50.0)
        label(sheet, x + 0.1, sheet.height - 0.4, 0.09, 0.16)
    elif fitting == 'g':
        for _ in range(int(2.6 * span * sheet.height)):
            width, height = sheet.rng.uniform(0.25, 1.0, 2).tolist()
            y = sheet.uniform(0.05, max(0.06, sheet.height - 0.2 - height))
            poster(sheet, x + sheet.uniform(0.0, span - width), y, width, height)


def timber(sheet: Painting, grey: float) -> None:
    """Veneer a sheet with wood that runs along its longer side."""
    sheet.fill(grey)
    along_x = sheet.width > sheet.height
    sheet.roughen(13.0, zoom=(9.0, 1.0) if along_x else (1.0, 9.0))
    sheet.roughen(4.0)
    sheet.frame(0.0, 0.0, sheet.width, sheet.height, line=0.012, grey=grey - 30.0)


def bookcase(sheet: Painting, grey: float) -> None:
    """Fill the front of a case with rows of books, every one its own."""
    timber(sheet, grey)
    for y in np.arange(0.05, sheet.height - 0.25, 0.36).tolist():
        x, board = 0.04, min(y + 0.32, sheet.height - 0.04)
        sheet.rect(x, y, sheet.width - 0.08, board - y, 38.0)
        while x < sheet.width - 0.1:
            thick, tall = sheet.uniform(0.018, 0.06), (board - y) * sheet.uniform(0.6, 0.93)
            _book(sheet, x, board - tall, thick, tall)
            x += thick if sheet.uniform(0.0, 1.0) < 0.93 else 0.15
    sheet.roughen(3.0)


def _book(sheet: Painting, x: float, y: float, thick: float, tall: float) -> None:
    grey = sheet.uniform(35.0, 235.0)
    sheet.rect(x, y, thick, tall, grey - 40.0)
    sheet.rect(x + 0.003, y, thick - 0.007, tall, grey)
    ink = grey - 110.0 if grey > 130.0 else grey + 110.0
    for band in sheet.rng.uniform(0.03, 0.95, int(sheet.rng.integers(1, 7))):
        high = tall * sheet.uniform(0.01, 0.05)
        sheet.rect(x + 0.003, y + band * tall, thick - 0.007, high, ink)


def cupboard(sheet: Painting, grey: float) -> None:
    """Close the front with doors and drawers that carry handles and labels."""
    timber(sheet, grey)
    columns, rows = max(1, round(sheet.width / 0.55)), max(1, round(sheet.height / 0.45))
    width, height = sheet.width / columns, sheet.height / rows
    for x in width * np.arange(columns):
        for y in height * np.arange(rows):
            box = (x + 0.015, y + 0.015, width - 0.03, height - 0.03)
            sheet.frame(*box, line=0.012, grey=sheet.uniform(25.0, 70.0))
            handle = x + width * sheet.uniform(0.35, 0.6), y + height * sheet.uniform(0.12, 0.3)
            sheet.rect(*handle, 0.12, 0.03, 225.0)
            sheet.rect(handle[0], handle[1] + 0.03, 0.12, 0.015, 25.0)
            if sheet.uniform(0.0, 1.0) < 0.6:
                left, top = width * sheet.uniform(0.1, 0.4), height * sheet.uniform(0.4, 0.6)
                label(sheet, x + left, y + top, 0.4 * width, 0.3 * height)
    wear(sheet, 4.0)


def crate(sheet: Painting, grey: float) -> None:
    """Nail a crate of slats, with labels."""
    sheet.fill(40.0)
    slat = sheet.uniform(0.09, 0.15)
    for y in np.arange(0.0, sheet.height, slat):
        sheet.rect(0.0, y + 0.004, sheet.width, slat - 0.01, grey + sheet.uniform(-35.0, 35.0))
    sheet.roughen(13.0, zoom=(8.0, 1.0))
    sheet.frame(0.0, 0.0, sheet.width, sheet.height, line=0.06, grey=grey - 35.0)
    for _ in range(int(3 + 7 * sheet.width * sheet.height)):
        size = sheet.uniform(0.12, 0.4) * min(sheet.width, sheet.height)
        x, y = sheet.rng.uniform((0.0, 0.0), (sheet.width - size, sheet.height - size)).tolist()
        label(sheet, x, y, size, 0.8 * size)
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


def faded(paint: Callable[..., None]) -> Callable[..., None]:
    """Return the painter that leaves CONTRAST of what ``paint`` paints."""

    def painter(sheet: Painting, *grey: float) -> None:
        paint(sheet, *grey)
        offset = (1.0 - CONTRAST) * MEAN
        sheet.pixels = np.asarray(cv2.convertScaleAbs(sheet.pixels, alpha=CONTRAST, beta=offset))

    return painter
