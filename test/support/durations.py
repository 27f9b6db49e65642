"""Which of many like values ``make test`` tries; ``make test-long`` tries the others."""

from collections.abc import Iterable, Sequence
from typing import Any

import pytest


def few_of(values: Sequence[Any], keep: Iterable[int] = (0,)) -> list[Any]:
    """Return ``values`` as parameters, all but those at ``keep`` marked ``long``."""
    kept = set(keep)
    return [
        value
        if index in kept
        else pytest.param(
            *(value if isinstance(value, tuple) else (value,)), marks=pytest.mark.long
        )
        for index, value in enumerate(values)
    ]
