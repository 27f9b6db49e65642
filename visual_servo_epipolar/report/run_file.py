"""
File of a run, ``run.json`` beside its figures: every sample, and the settings it ran with.

Numbers are written so that they come back to the last bit; what could not be measured is null.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
import json
import math
from pathlib import Path
from typing import Any

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.laws.registry import phase_named
from visual_servo_epipolar.core.servo.run_log import MotionLimits, RunLog, Sample
from visual_servo_epipolar.files import whole

FILE = 'run.json'
FORMAT = 1
PLAIN = (  # fields of a Sample that are numbers as they stand
    'features',
    'epipole_current',
    'epipole_desired',
    'bearing_current',
    'bearing_desired',
    'feature_difference',
    'feature_error',
    'distance_estimate',
)
HEAD = ('seed', 'outcome', 'reason', 'attempts', 'law')


@dataclass(frozen=True, slots=True)
class RunFile:
    """Content of a run file: the run, its settings by part, and the versions it ran on."""

    log: RunLog
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)


def save_run(run: RunFile, folder: Path) -> Path:
    """Write ``run`` into ``folder`` and return the file; it appears whole, by rename."""
    path = folder / FILE
    text = json.dumps(_document(run), allow_nan=False) + '\n'
    try:
        with whole(path) as partial:
            partial.write_text(text, encoding='utf-8')
    except OSError as error:
        raise InputError(f'{path}: run cannot be written: {error.strerror}') from None
    return path


def load_run(folder: Path) -> RunFile:
    """Read the run in ``folder``; raises InputError if it cannot be read or used."""
    path = folder / FILE
    try:
        document = json.loads(path.read_text(encoding='utf-8'))
        if document['format'] != FORMAT:
            raise ValueError(f'format must be {FORMAT}, got {document["format"]!r}')
        return _run(document)
    except OSError as error:
        raise InputError(f'{path}: run cannot be read: {error.strerror}') from None
    except (AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        text = ' '.join(str(error).split())
        raise InputError(
            f'{path}: not a run: {text}; create it again by demo or simulate'
        ) from None


def _document(run: RunFile) -> dict[str, Any]:
    samples = run.log.samples
    return {
        'format': FORMAT,
        'versions': dict(run.versions),
        'settings': {part: dict(values) for part, values in run.settings.items()},
        'start': list(run.log.start),
        'field_of_view': run.log.field_of_view,
        'limits': None if run.log.limits is None else asdict(run.log.limits),
        **{name: getattr(run.log, name) for name in HEAD},
        'samples': {
            'stamp_ns': [item.stamp_ns for item in samples],
            'x': [item.pose.x for item in samples],
            'y': [item.pose.y for item in samples],
            'theta': [item.pose.theta for item in samples],
            'linear': [item.twist.linear for item in samples],
            'angular': [item.twist.angular for item in samples],
            'phase': [item.phase.value for item in samples],
            **{name: [_finite(getattr(item, name)) for item in samples] for name in PLAIN},
        },
    }


def _run(document: Mapping[str, Any]) -> RunFile:
    columns = document['samples']
    x, y, heading = (float(value) for value in document['start'])
    samples = tuple(
        _sample(dict(zip(columns, row, strict=True)))
        for row in zip(*columns.values(), strict=True)
    )
    if not samples:
        raise ValueError('it has no samples')
    head = {name: document[name] for name in HEAD}
    angle = document.get('field_of_view')
    view = None if angle is None else float(angle)
    given = document.get('limits')
    limits = None if given is None else MotionLimits(**{it: float(given[it]) for it in given})
    log = RunLog((x, y, heading), samples=samples, field_of_view=view, limits=limits, **head)
    return RunFile(log, dict(document['settings']), dict(document['versions']))


def _sample(row: Mapping[str, Any]) -> Sample:
    return Sample(
        stamp_ns=int(row['stamp_ns']),
        pose=Pose(float(row['x']), float(row['y']), float(row['theta'])),
        twist=Twist(float(row['linear']), float(row['angular'])),
        phase=phase_named(row['phase']),
        features=int(row['features']),
        **{name: math.nan if row[name] is None else float(row[name]) for name in PLAIN[1:]},
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
