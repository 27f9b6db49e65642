"""Furniture: timber, and fronts full of books, labels and notices; grey in 0..255."""

import numpy as np

from visual_servo_epipolar.simulation.rooms.materials import wear
from visual_servo_epipolar.simulation.rooms.pictures import books, lettering, poster, tone
from visual_servo_epipolar.simulation.rooms.textures import Painting


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
