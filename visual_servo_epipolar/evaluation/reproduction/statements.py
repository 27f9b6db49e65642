"""Statements: claims of the paper beside our results, and whether the two agree."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Statement:
    """
    One claim of the paper beside our result.

    ``place`` is where the paper makes it; ``agrees`` is None where its text gives nothing to
    compare with, and then ``paper`` says so.
    """

    place: str
    paper: str
    ours: str
    agrees: bool | None = None

    @property
    def agreement(self) -> str:
        """Whether the two agree, in a word."""
        return {True: 'yes', False: 'no', None: '-'}[self.agrees]


NO_NUMBER = 'the text gives no number'


def document(statements: Sequence[Statement]) -> list[dict[str, Any]]:
    """Return the statements as JSON has them."""
    return [asdict(statement) for statement in statements]


def markdown(title: str, statements: Sequence[Statement]) -> str:
    """Return the statements as a table in Markdown under a heading."""
    lines = [f'## {title}', '', '| | the paper | ours | agrees |', '|---|---|---|---|']
    rows = [(s.place, s.paper, s.ours, s.agreement) for s in statements]
    lines += ['| ' + ' | '.join(cell.replace('|', '\\|') for cell in row) + ' |' for row in rows]
    return '\n'.join(lines) + '\n'


def plain(title: str, statements: Sequence[Statement]) -> str:
    """Return the statements as people read them on a terminal, one result a line."""
    marks = {True: 'agrees   ', False: 'DISAGREES', None: 'no number'}
    lines = [f'  {marks[s.agrees]}  {s.place}: {s.ours}' for s in statements]
    return '\n'.join([title, *lines])
