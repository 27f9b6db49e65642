"""The document of the soak as text, and its figures for the history."""

from collections import Counter
from collections.abc import Mapping
from typing import Any

HELD = ('memory_mb', 'threads', 'handles')


def figures(document: Mapping[str, Any]) -> dict[str, float]:
    """Return what to compare between soaks; less is better."""
    grown = {
        f'{name} grows by [MB]': last['memory_mb'] - first['memory_mb']
        for name, first, last in _ends(document)
    }
    return {'missed deadlines [%]': 1e2 * _missed_share(document), **grown}


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: endings and deadlines, then what each process holds."""
    runs, (width, height) = document['runs'], document['size']
    endings = Counter(run['phase'] for run in runs)
    lines = [
        f'Soak: {len(runs)} runs of four processes in {runs[-1]["after_s"]:.0f} s, '
        f'{width}x{height} at {document["rate"]:g} Hz',
        'ended in ' + ', '.join(f'{phase}: {count}' for phase, count in endings.items()),
        f'{sum(run["images"] for run in runs)} images, {_missed_share(document):.2%} of them '
        'without a twist before the next image is due',
        '',
        f'{"after the first run -> the last":<32}{"memory MB":>18}{"threads":>12}{"handles":>14}',
    ]
    return '\n'.join(lines + [_row(*ends) for ends in _ends(document)])


def _missed_share(document: Mapping[str, Any]) -> float:
    runs = document['runs']
    return float(sum(run['missed'] for run in runs) / sum(run['images'] for run in runs))


def _ends(document: Mapping[str, Any]) -> list[tuple[str, dict[str, Any], dict[str, Any]]]:
    """Return each process, what it held after the first run and after the last."""
    first, last = (document['runs'][index]['processes'] for index in (0, -1))
    return [(name, first[name], last[name]) for name in first]


def _row(name: str, first: Mapping[str, Any], last: Mapping[str, Any]) -> str:
    memory, threads, handles = (f'{first[key]:.0f} -> {last[key]:.0f}' for key in HELD)
    return f'{name:<32}{memory:>18}{threads:>12}{handles:>14}'
