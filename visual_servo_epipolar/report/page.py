"""HTML page with all its figures, tables and pictures inside."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
import io
from pathlib import Path
from string import Template

import cv2
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.files import whole
from visual_servo_epipolar.report.style import FIGURE_SETTINGS

FILE = 'report.html'
PICTURE_WIDTH = 800  # [px]
QUALITY = 80  # of a JPEG
RIGHT, CHANGED = ' class="number"', ' class="changed"'  # of cells, of rows
Cell = str | float | int | None


@dataclass(frozen=True, slots=True)
class Headline:
    """Verdict at the head of a page: a line, whether it is good news, and a few words more."""

    text: str
    good: bool
    more: str = ''


@dataclass(frozen=True, slots=True)
class Section:
    """Section of a page: a heading, and the HTML below it."""

    title: str
    body: str


def write_page(
    path: Path, title: str, verdict: Headline, sections: Sequence[Section], *, footer: str = ''
) -> Path:
    """Write the page, by rename, and return its path; raises InputError if it cannot be."""
    template = Template(Path(__file__).with_name('page.html').read_text(encoding='utf-8'))
    tone = 'good' if verdict.good else 'bad'
    text = template.substitute(
        title=escape(title),
        verdict=f'<p class="verdict {tone}">{escape(verdict.text)}</p>'
        + (f'<p class="lead">{escape(verdict.more)}</p>' if verdict.more else ''),
        body='\n'.join(f'<h2>{escape(item.title)}</h2>\n{item.body}' for item in sections),
        footer=escape(footer),
    )
    try:
        with whole(path) as partial:
            partial.write_text(text, encoding='utf-8')
    except OSError as error:
        raise InputError(f'{path}: report cannot be written: {error.strerror}') from None
    return path


def figure_html(figure: Figure, caption: str) -> str:
    """Return a matplotlib figure as HTML: vectors, so that it stays sharp."""
    buffer = io.BytesIO()
    with rc_context({**FIGURE_SETTINGS, 'svg.hashsalt': 'visual_servo'}):  # twice the same
        figure.draw_without_rendering()
        figure.set_layout_engine('none')
        for axes in figure.axes:  # the solver of the layout rounds otherwise each time
            bounds = (round(part, 6) for part in axes.get_position().bounds)
            axes.set_position(Bbox.from_bounds(*bounds))
        figure.savefig(buffer, format='svg', metadata={'Date': None})
    return _figure('image/svg+xml', buffer.getvalue(), caption)


def strip(pictures: Sequence[tuple[bytes, str]], *, wide: bool = False) -> str:
    """Return JPEGs with their captions, three beside each other, or two that are ``wide``."""
    figures = [_figure('image/jpeg', data, caption) for data, caption in pictures]
    return f'<div class="strip{" wide" if wide else ""}">' + '\n'.join(figures) + '</div>'


def film(data: bytes, mime: str, caption: str) -> str:
    """Return a video with controls, inside the page."""
    source = f'data:{mime};base64,{base64.b64encode(data).decode("ascii")}'
    return linked_film(source, caption)


def linked_film(source: str, caption: str) -> str:
    """Return a video with controls that the page loads from ``source``."""
    return (
        f'<figure><video controls muted src="{escape(source)}"></video>'
        f'<figcaption>{escape(caption)}</figcaption></figure>'
    )


def jpeg(picture: Image) -> bytes:
    """Return ``picture`` as JPEG, no wider than it is shown."""
    scale = PICTURE_WIDTH / picture.shape[1]
    if scale < 1.0:
        picture = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    _, encoded = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    return bytes(encoded)


def table(
    head: Sequence[str], rows: Sequence[Sequence[Cell]], *, changed: Sequence[bool] = ()
) -> str:
    """Return a table; numbers stand to the right, ``changed`` rows in bold."""
    marks = changed or [False] * len(rows)
    numeric = [bool(rows) and isinstance(rows[0][k], (int, float)) for k in range(len(head))]

    def line(tag: str, cells: Sequence[Cell], mark: bool = False) -> str:
        parts = [
            f'<{tag}{RIGHT if right else ""}>{escape(_text(cell))}</{tag}>'
            for cell, right in zip(cells, numeric, strict=True)
        ]
        return f'<tr{CHANGED if mark else ""}>{"".join(parts)}</tr>'

    lines = [line('td', row, mark) for row, mark in zip(rows, marks, strict=True)]
    return '\n'.join(['<table>', line('th', head), *lines, '</table>'])


def folded_html(title: str, body: str) -> str:
    """Return ``body`` behind a line that unfolds it."""
    return f'<details><summary>{escape(title)}</summary>\n{body}\n</details>'


def paragraph(text: str) -> str:
    """Return ``text`` as a paragraph."""
    return f'<p>{escape(text)}</p>'


def _text(value: Cell) -> str:
    if value is None:
        return '\N{EN DASH}'
    return f'{value:.6g}' if isinstance(value, float) else str(value)


def _figure(kind: str, data: bytes, caption: str) -> str:
    source = f'data:{kind};base64,{base64.b64encode(data).decode("ascii")}'
    text = escape(caption)
    return f'<figure><img src="{source}" alt="{text}"><figcaption>{text}</figcaption></figure>'
