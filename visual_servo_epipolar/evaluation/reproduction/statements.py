"""Statements: claims of the paper beside our results, and whether the two agree."""

from collections.abc import Sequence
from dataclasses import dataclass

from visual_servo_epipolar.evaluation.tables import markdown


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


def markdown_of(title: str, statements: Sequence[Statement]) -> str:
    """Return the statements as a table in Markdown under a heading."""
    rows = [(s.place, s.paper, s.ours, s.agreement) for s in statements]
    head = ' | the paper | ours | agrees'
    return '\n'.join([f'## {title}', '', *markdown(head, rows), ''])


def plain(title: str, statements: Sequence[Statement]) -> str:
    """Return the statements as people read them on a terminal, one result a line."""
    marks = {True: 'agrees   ', False: 'DISAGREES', None: 'no number'}
    lines = [f'  {marks[s.agrees]}  {s.place}: {s.ours}' for s in statements]
    return '\n'.join([title, *lines])
