"""The document of the benchmark of laws as text."""

from collections.abc import Mapping
import math
from typing import Any

HEAD = (
    f'{"region  law":<26}{"reached":>9}{"lost":>7}{"wrong":>7}{"position med/p95":>19}'
    f'{"heading med":>13}{"path":>7}{"time":>8}{"features":>10}'
)
UNITS = f'{"":<26}{"%":>9}{"%":>7}{"%":>7}{"mm":>19}{"deg":>13}{"x d_0":>7}{"s":>8}{"fewest":>10}'


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: one row a law and region."""
    reached = document['reached']
    return '\n'.join(
        [
            f'Laws: {document["starts"]} starts a region, point features at 0.2 px, at most '
            f'{document["longest_s"]:g} s; reached means within {reached["position_m"]:g} m and '
            f'{reached["heading_deg"]:g} deg',
            '(lost: the features; wrong: arrived, it says, but not reached; position and heading '
            'of all that did not lose the features, path and time of those that reached)',
            '',
            HEAD,
            UNITS,
            *(_row(it) for it in document['rows']),
        ]
    )


def _row(it: Mapping[str, Any]) -> str:
    shares = ''.join(f'{100.0 * it[k]:{w}.0f}' for k, w in (('reached', 9), ('lost', 7)))
    position = f'{_mm(it["position_median_m"])}/{_mm(it["position_p95_m"])}'
    return (
        f'{it["region"]:<8}{it["law"]:<18}{shares}{100.0 * it["wrong"]:7.0f}{position:>19}'
        f'{_number(it["heading_median_deg"], 2):>13}{_number(it["path_ratio"], 2):>7}'
        f'{_number(it["duration_s"], 0):>8}{it["fewest_features"]:10.0f}'
    )


def _mm(value: float) -> str:
    return _number(1e3 * value, 1 if 1e3 * value < 100.0 else 0)


def _number(value: float, digits: int) -> str:
    return '-' if math.isnan(value) else f'{value:.{digits}f}'
