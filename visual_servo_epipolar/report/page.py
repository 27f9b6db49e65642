"""HTML page with all its figures, tables and pictures inside."""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
import io
from pathlib import Path
from string import Template

from matplotlib import rc_context
from matplotlib.figure import Figure

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.files import whole
from visual_servo_epipolar.report.style import FIGURE_SETTINGS

FILE = 'report.html'


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
    with rc_context(FIGURE_SETTINGS):
        figure.savefig(buffer, format='svg')
    data, text = base64.b64encode(buffer.getvalue()).decode('ascii'), escape(caption)
    image = f'<img src="data:image/svg+xml;base64,{data}" alt="{text}">'
    return f'<figure>{image}<figcaption>{text}</figcaption></figure>'


def table(head: Sequence[str], rows: Sequence[Sequence[str | None]]) -> str:
    """Return a table; a dash for None."""

    def line(tag: str, cells: Sequence[str | None]) -> str:
        parts = ('\N{EN DASH}' if cell is None else escape(cell) for cell in cells)
        return f'<tr>{"".join(f"<{tag}>{part}</{tag}>" for part in parts)}</tr>'

    return '\n'.join(['<table>', line('th', head), *(line('td', row) for row in rows), '</table>'])
