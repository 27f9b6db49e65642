"""
History of benchmarks: one JSON object a line, and what got worse since the last one.

Only figures of one machine are compared; less is better in all of them.
"""

from collections.abc import Mapping, Sequence
from datetime import datetime, timezone
import json
import os
from pathlib import Path
import platform
from typing import Any

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.sweeping.provenance import commit

WORSE = 1.15  # times what it was; medians of runs on a shared machine differ by a tenth
KEYS = {'date', 'commit', 'machine', 'figures'}

Figures = Mapping[str, Mapping[str, float]]  # by benchmark, by name


def entry(figures: Figures) -> dict[str, Any]:
    """Return what goes into the history: figures with day, commit and machine."""
    day = datetime.now(timezone.utc).date().isoformat()
    return {'date': day, 'commit': commit(), 'machine': machine(), 'figures': figures}


def machine() -> str:
    """Return processor, cores and Python of this machine."""
    try:
        lines = Path('/proc/cpuinfo').read_text().splitlines()
        name = next(line.split(':')[1].strip() for line in lines if line.startswith('model name'))
    except (OSError, StopIteration):
        name = platform.processor() or platform.machine()
    return f'{name}, {os.cpu_count()} cores, Python {platform.python_version()}'


def read(path: Path) -> list[dict[str, Any]]:
    """Return the entries of a history, the newest last; none if there is no file yet."""
    if not path.exists():
        return []
    try:
        lines = path.read_text(encoding='utf-8').splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise InputError(f'{path}: history cannot be read: {reason}') from None
    entries = []
    for number, line in enumerate(lines, 1):
        try:
            item = json.loads(line)
        except ValueError:
            item = None
        if not isinstance(item, dict) or KEYS - item.keys():
            raise InputError(
                f'{path}, line {number}: not an entry of a history of benchmarks, which has '
                f'{", ".join(sorted(KEYS))}; name another file by --history'
            )
        entries.append(item)
    return entries


def append(path: Path, item: Mapping[str, Any]) -> None:
    """Append an entry."""
    try:
        with path.open('a') as file:
            file.write(json.dumps(item, sort_keys=True) + '\n')
    except OSError as error:
        raise InputError(f'{path}: history cannot be written: {error.strerror}') from None


def comparison(entries: Sequence[Mapping[str, Any]], now: Mapping[str, Any]) -> str:
    """Return as text how each figure has changed since it was last measured on this machine."""
    lines = [f'{"figure":<62}{"before":>10}{"now":>10}{"times":>8}  since']
    last: dict[str, tuple[float, str]] = {}  # value and commit
    for item in entries:
        if item['machine'] == now['machine']:
            last |= {name: (float(it), str(item['commit'])) for name, it in _named(item).items()}
    lines += [_row(name, last.get(name), value) for name, value in _named(now).items()]
    worse = sum(line.endswith('WORSE') for line in lines)
    lines.append(f'{worse} figures got worse by more than {WORSE - 1.0:.0%}')
    return '\n'.join(lines)


def _named(item: Mapping[str, Any]) -> dict[str, float]:
    figures = item['figures'].items()
    return {f'{benchmark}: {name}': it for benchmark, of in figures for name, it in of.items()}


def _row(title: str, last: tuple[float, str] | None, value: float) -> str:
    if last is None:
        return f'{title:<62}{"-":>10}{value:>10.3g}{"-":>8}  new'
    before, since = last
    times = f'{value / before:.2f}' if before > 0.0 else '-'
    word = '  WORSE' if value > WORSE * before else ''
    return f'{title:<62}{before:>10.3g}{value:>10.3g}{times:>8}  {since}{word}'
