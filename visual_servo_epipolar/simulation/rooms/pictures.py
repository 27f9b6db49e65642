"""Pictures and fittings: posters, windows, doors, books; lengths in m, grey in 0..255."""

import math

import numpy as np

from visual_servo_epipolar.simulation.rooms.textures import Painting

LETTERS = 'ABCDEFGHKLMNPRSTUVWXYZaeioustnr0123456789'


def word(sheet: Painting, length: int) -> str:
    """Return random letters."""
    return ''.join(sheet.rng.choice(list(LETTERS), length))


def tone(sheet: Painting, low: float = 20.0, high: float = 240.0) -> float:
    """Return a random grey."""
    return float(sheet.rng.uniform(low, high))


def lettering(
    sheet: Painting, x: float, y: float, width: float, height: float, ink: float
) -> None:
    """Fill an area with a headline and paragraphs of text-like lines."""
    head = min(0.16 * height, 0.2 * width)
    sheet.text(word(sheet, max(2, int(width / head))), x, y + head, 0.8 * head, ink)
    line = max(0.018, 0.03 * height)
    row = y + 1.7 * head
    while row < y + height - line:
        at, end = x, x + width * float(sheet.rng.uniform(0.6, 1.0))
        while at < end - line:
            length = line * float(sheet.rng.uniform(0.6, 3.5))
            sheet.rect(at, row, min(length, end - at), 0.55 * line, ink + tone(sheet, -20.0, 40.0))
            at += length + 0.5 * line
        row += line * float(sheet.rng.choice([1.0, 1.0, 1.0, 1.9]))


def shapes(sheet: Painting, x: float, y: float, width: float, height: float) -> None:
    """Fill an area with discs, bars and polygons of all sizes: abstract art."""
    rng = sheet.rng
    sheet.rect(x, y, width, height, tone(sheet))
    for size in 0.45 * min(width, height) * 0.82 ** np.arange(22):
        at = (
            np.array([x, y])
            + size
            + rng.uniform(0.0, 1.0, 2) * (np.array([width, height]) - 2 * size)
        )
        corners = int(rng.integers(3, 8))
        turns = np.sort(rng.uniform(0.0, 2.0 * math.pi, corners))
        if rng.uniform() < 0.35:
            sheet.disc(float(at[0]), float(at[1]), float(size), tone(sheet))
        else:
            outline = at + size * np.stack([np.cos(turns), np.sin(turns)], axis=1)
            sheet.polygon(outline, tone(sheet))


def mosaic(sheet: Painting, x: float, y: float, width: float, height: float) -> None:
    """Fill an area with a checker whose fields are light and dark, but no two alike."""
    columns = int(sheet.rng.integers(4, 9))
    cell = width / columns
    for row in range(math.ceil(height / cell)):
        for column in range(columns):
            dark = sheet.rng.uniform() < 0.25 + 0.5 * ((row + column) % 2)
            grey = tone(sheet, 15.0, 90.0) if dark else tone(sheet, 150.0, 245.0)
            size = min(cell, y + height - (y + row * cell))
            sheet.rect(x + column * cell, y + row * cell, cell, size, grey)


def landscape(sheet: Painting, x: float, y: float, width: float, height: float) -> None:
    """Fill an area with a sky, a sun or moon, and ranges of hills getting darker."""
    rng, across = sheet.rng, np.linspace(0.0, 1.0, 60)
    for k, grey in enumerate(np.linspace(tone(sheet, 190.0, 240.0), tone(sheet, 130.0, 180.0), 8)):
        sheet.rect(x, y + k * height / 8, width, height / 8, float(grey))
    radius = 0.1 * min(width, height)
    sheet.disc(
        x + width * rng.uniform(0.2, 0.8), y + height * rng.uniform(0.15, 0.4), radius, 250.0
    )
    for k in range(4):
        waves = [
            np.sin(2.0 * math.pi * (f * across + rng.uniform())) / f for f in (1, 2.3, 5, 11, 23)
        ]
        crest = y + height * (0.45 + 0.13 * k + 0.09 * sum(waves))
        ridge = np.stack([x + across * width, np.clip(crest, y, y + height)], axis=1)
        corners = [(x + width, y + height), (x, y + height)]
        sheet.polygon(np.concatenate([ridge, corners]), 120.0 - 28.0 * k + tone(sheet, -10, 10))


def poster(sheet: Painting, x: float, y: float, width: float, height: float) -> None:
    """Hang a framed picture: text, abstract art, a mosaic, or a landscape with its title."""
    sheet.pictures.append((x, y, width, height))
    sheet.rect(x + 0.012, y + 0.018, width + 0.012, height + 0.012, 70.0)  # its shadow
    sheet.rect(x, y, width, height, float(sheet.rng.choice([25.0, 60.0, 215.0])))
    line = float(sheet.rng.uniform(0.015, 0.04))
    x, y, width, height = x + line, y + line, width - 2 * line, height - 2 * line
    sheet.rect(x, y, width, height, tone(sheet, 205.0, 245.0))
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
        size = float(sheet.rng.uniform(0.08, 0.3)) * width / 2.0
        left, tall = (
            x + float(sheet.rng.uniform(0.0, 1.0)) * (width - size),
            size * tone(sheet, 0.5, 1.6),
        )
        sheet.rect(left, y + height - tall, size, tall, tone(sheet, 60.0, 200.0))
        for row in np.arange(y + height - 0.8 * tall, y + height, 0.09):
            for column in np.arange(left + 0.02, left + size - 0.04, 0.07):
                sheet.rect(column, row, 0.03, 0.045, tone(sheet, 20.0, 250.0))
    for share in (0.0, 0.5, 1.0):
        sheet.rect(x - 0.025 + share * width, y, 0.05, height, 232.0)
        sheet.rect(x - 0.008 + share * width, y, 0.01, height, 120.0)
    for share in (0.0, 0.36, 1.0):
        sheet.rect(x, y - 0.025 + share * height, width, 0.05, 228.0)
    sheet.rect(x - 0.12, y + height + 0.05, width + 0.24, 0.05, 240.0)
    sheet.rect(x - 0.12, y + height + 0.1, width + 0.24, 0.02, 110.0)


def door(sheet: Painting, x: float, width: float, height: float) -> None:
    """Put a door with panels, handle and sign, standing on the lower edge."""
    y, grey = sheet.height - height, tone(sheet, 85.0, 150.0)
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
        thick, tall = float(rng.uniform(0.018, 0.06)), height * float(rng.uniform(0.6, 0.93))
        if rng.uniform() < 0.06:
            at += float(rng.uniform(0.05, 0.2))
            continue
        thick = min(thick, x + width - at)
        _book(sheet, (at, y + height - tall, thick, tall), tone(sheet, 35.0, 235.0))
        at += thick


def _book(sheet: Painting, box: tuple[float, float, float, float], grey: float) -> None:
    x, y, thick, tall = box
    sheet.rect(x, y, thick, tall, grey - 40.0)
    sheet.rect(x + 0.003, y + 0.002, thick - 0.007, tall, grey)
    ink = grey - 110.0 if grey > 130.0 else grey + 110.0
    for band in sheet.rng.uniform(0.03, 0.95, int(sheet.rng.integers(1, 4))):
        sheet.rect(x + 0.003, y + band * tall, thick - 0.007, tall * tone(sheet, 0.01, 0.05), ink)
    if thick > 0.03:
        start, steps = y + 0.25 * tall, int(sheet.rng.integers(4, 9))
        for k in range(steps):
            sheet.rect(
                x + 0.3 * thick,
                start + 0.06 * k * tall,
                tone(sheet, 0.2, 0.4) * thick,
                0.03 * tall,
                ink,
            )
