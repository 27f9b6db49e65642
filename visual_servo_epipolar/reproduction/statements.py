"""The table: what the paper says, what we find, whether the two agree."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Statement:
    """
    One claim of the paper beside our finding.

    ``place`` is where the paper makes it; ``agrees`` is None where its text gives nothing to
    compare with, and then ``paper`` says so.
    """

    place: str
    paper: str
    ours: str
    agrees: bool | None = None

    @property
    def verdict(self) -> str:
        """The verdict in a word."""
        return {True: 'yes', False: 'no', None: '-'}[self.agrees]


NO_NUMBER = 'the text gives no number'


def document(statements: Sequence[Statement]) -> list[dict[str, Any]]:
    """Return the statements as JSON has them."""
    return [asdict(statement) for statement in statements]


def markdown(title: str, statements: Sequence[Statement]) -> str:
    """Return the statements as a table in Markdown under a heading."""
    lines = [f'## {title}', '', '| | the paper | ours | agrees |', '|---|---|---|---|']
    rows = [(s.place, s.paper, s.ours, s.verdict) for s in statements]
    lines += ['| ' + ' | '.join(cell.replace('|', '\\|') for cell in row) + ' |' for row in rows]
    return '\n'.join(lines) + '\n'


def plain(title: str, statements: Sequence[Statement]) -> str:
    """Return the statements as people read them on a terminal, one finding a line."""
    marks = {True: 'agrees   ', False: 'DISAGREES', None: 'no number'}
    lines = [f'  {marks[s.agrees]}  {s.place}: {s.ours}' for s in statements]
    return '\n'.join([title, *lines])
