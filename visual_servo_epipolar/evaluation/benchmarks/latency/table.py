"""The document of the latency benchmark as text, and its figures for the history."""

from collections.abc import Mapping
from typing import Any


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: latencies and floor, then what each process costs."""
    lines = [
        f'Latency, image on the wire to twist on the wire; nodes {document["nodes"]}, '
        f'{document["seconds"]:g} s a row, [ms]',
        '',
        f'{"size and rate":<20}{"p50":>7}{"p99":>7}{"p99.9":>7}{"images":>8}{"drops":>7}'
        f'{"as driven":>11}{"echo p50":>10}{"p99":>6}{"tracker":>9}{"servo":>7}{"floor":>7}'
        f'{"ratio":>7}{"tracker, servo at the rate":>28}{"floor":>7}{"ratio":>7}',
    ]
    lines += [_row(row) for row in document['rows']]
    lines += [
        '',
        f'{"":<20}{"process":<16}{"processor ms a frame":>22}{"memory MB":>14}{"peak":>7}',
    ]
    for row in document['rows']:
        lines += [_cost(row, name, it) for name, it in row['processes'].items()]
    return '\n'.join(lines)


def figures(document: Mapping[str, Any]) -> dict[str, float]:
    """Return what to compare between runs; less is better."""
    rows = {}
    for row in document['rows']:
        size = 'x'.join(map(str, row['size']))
        rows[f'{size} p50 over floor'] = row['nodes']['p50'] / row['floor']['sum_ms']
        rows[f'{size} p50 over floor at the rate'] = (
            row['nodes']['p50'] / row['paced_floor']['sum_ms']
        )
        rows[f'{size} p99 [ms]'] = row['nodes']['p99']
        rows[f'{size} drops'] = float(row['nodes']['drops'])
    return rows


def _row(row: Mapping[str, Any]) -> str:
    nodes, echo, floor, paced = (row[it] for it in ('nodes', 'echo', 'floor', 'paced_floor'))
    same = '-' if nodes['as_driven'] is None else f'{nodes["as_driven"]:.1%}'
    both = f'{paced["tracker_ms"]:.1f}, {paced["servo_ms"]:.1f}'
    return (
        f'{_title(row):<20}{nodes["p50"]:7.1f}{nodes["p99"]:7.1f}{nodes["p99.9"]:7.1f}'
        f'{nodes["images"]:8d}{nodes["drops"]:7d}{same:>11}'
        f'{echo["p50"]:10.1f}{echo["p99"]:6.1f}{floor["tracker_ms"]:9.1f}{floor["servo_ms"]:7.1f}'
        f'{floor["sum_ms"]:7.1f}{nodes["p50"] / floor["sum_ms"]:7.2f}'
        f'{both:>28}{paced["sum_ms"]:7.1f}{nodes["p50"] / paced["sum_ms"]:7.2f}'
    )


def _cost(row: Mapping[str, Any], name: str, it: Mapping[str, Any]) -> str:
    before, after = it['memory_mb']
    memory = f'{before:.0f} -> {after:.0f}'
    return f'{_title(row):<20}{name:<16}{it["processor_ms"]:22.1f}{memory:>14}{it["peak_mb"]:7.0f}'


def _title(row: Mapping[str, Any]) -> str:
    width, height = row['size']
    return f'{width}x{height}, {row["rate"]:g} Hz'
