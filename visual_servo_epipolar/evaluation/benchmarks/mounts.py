"""
Arrivals, errors, excursions and time on a wrong geometry, over mounts, image sizes and lenses.

A cell is one camera on one mount; a new lens or size is a row here.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from itertools import product
import math
from typing import Any

from visual_servo_epipolar.evaluation.benchmarks.sweeps import ARRIVALS, measure, sweep, TIME
from visual_servo_epipolar.evaluation.tables import cells, Columns, markdown, number, numbers
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.scenario import from_document, Scenario

TILTS = (-25.0, -15.0, -10.0, -6.0, 0.0, 6.0, 10.0, 15.0, 25.0)  # [deg]
ROLLS = (0.0, 8.0)
YAWS = (0.0, 3.0, 5.0, 10.0)
AHEADS, ASIDES = (0.0, 0.2, 0.3), (0.0, 0.1)  # [m]

SIZES = ((320, 240), (320, 256), (640, 480), (1280, 1024), (1920, 1080))
FISHEYE = {'distortion_model': 'equidistant', 'distortion': [0.0, 0.0, 0.0, 0.0]}
# Settings of the camera by the name of the lens.
LENSES: Mapping[str, Mapping[str, Any]] = {
    'pinhole, 56 deg': {'focal_length': 1200.0},
    'pinhole, 100 deg': {'focal_length': 537.0},
    'plumb_bob, barrel': {'distortion': [-0.25, 0.08, 0.0005, -0.0005, 0.0]},
    'plumb_bob, pincushion': {'distortion': [0.12, 0.05, 0.0, 0.0, 0.0]},
    'equidistant, 180 deg': {'focal_length': 407.4, **FISHEYE},
    'equidistant, 220 deg': {'focal_length': 333.3, **FISHEYE},
}


@dataclass(frozen=True, kw_only=True)
class CameraPlace:
    """Where the camera sits: angles [deg] down, clockwise, left; ahead, left of the axle [m]."""

    tilt: float = 0.0
    roll: float = 0.0
    yaw: float = 0.0
    ahead: float = 0.0
    aside: float = 0.0

    def settings(self) -> dict[str, float]:
        """Return the settings of the simulated camera."""
        return {
            'tilt': math.radians(self.tilt),
            'roll': math.radians(self.roll),
            'mount_yaw': math.radians(self.yaw),
            'mount_forward': self.ahead,
            'mount_left': self.aside,
        }

    def __str__(self) -> str:
        parts = {
            f'tilt {self.tilt:+g} deg': self.tilt,
            f'roll {self.roll:+g} deg': self.roll,
            f'yaw {self.yaw:+g} deg': self.yaw,
            f'{self.ahead:g} m ahead': self.ahead,
            f'{self.aside:g} m aside': self.aside,
        }
        return ', '.join(text for text, value in parts.items() if value) or 'level'


LEVEL, LEANING = CameraPlace(), CameraPlace(tilt=10.0, roll=3.0)
# What looked harmless and drove 18 m away in another world, and the worst of everything.
WORSE = (
    CameraPlace(tilt=4.0, ahead=0.13, aside=0.05),
    CameraPlace(tilt=-8.0),
    CameraPlace(tilt=6.0, roll=3.0, yaw=3.0, ahead=0.13, aside=0.05),
    CameraPlace(tilt=30.0, roll=10.0, yaw=10.0, ahead=0.3, aside=0.1),
    CameraPlace(tilt=-30.0, roll=-10.0, yaw=-10.0, ahead=0.3, aside=-0.1),
)


@dataclass(frozen=True, kw_only=True)
class MountCell:
    """One row of the bench: of a ``group``, by ``name``; ``camera`` and ``base`` are settings."""

    group: str
    name: str
    mount: CameraPlace = LEVEL
    camera: Mapping[str, Any] = field(default_factory=dict)
    base: Mapping[str, Any] = field(default_factory=dict)

    def scenario(self, longest_s: float) -> Scenario:
        """Return the scenario of the cell; the servo is given nothing of the mount."""
        sections = {
            'camera': {**self.mount.settings(), **self.camera},
            'base': dict(self.base),
            'run': {'max_duration': longest_s},
        }
        return from_document(sections, f'bench of mounts, {self.name}')


def of_mount(group: str, mount: CameraPlace, **parts: Mapping[str, Any]) -> MountCell:
    """Return the cell of a mount, named after it."""
    return MountCell(group=group, name=str(mount), mount=mount, **parts)


def camera_of_size(width: int, height: int) -> dict[str, Any]:
    """Return the camera of that size [px] with the field of view of the default one."""
    return {
        'width': width,
        'height': height,
        'focal_length': CameraSettings.focal_length * width / CameraSettings.width,
        'principal_u': 0.5 * (width - 1),
        'principal_v': 0.5 * (height - 1),
    }


def on_features(*, quick: bool = False) -> Iterator[MountCell]:
    """Yield the cells that are driven on point features."""
    if quick:
        yield from (of_mount('attitude', mount) for mount in (LEVEL, CameraPlace(tilt=6.0)))
        return
    for roll, tilt in product(ROLLS, TILTS):
        yield of_mount('attitude', CameraPlace(tilt=tilt, roll=roll))
    for ahead, aside, yaw in product(AHEADS, ASIDES, YAWS):
        yield of_mount('yaw', CameraPlace(yaw=yaw, ahead=ahead, aside=aside))
    for mount in WORSE:
        yield of_mount('worse', mount, base={'wheel_ratio': 1.01})
    for (width, height), mount in product(SIZES, (LEVEL, LEANING)):
        name = f'{width}x{height}, {mount}'
        yield MountCell(group='size', name=name, mount=mount, camera=camera_of_size(width, height))
    for (lens, camera), mount in product(LENSES.items(), (LEVEL, LEANING)):
        yield MountCell(group='lens', name=f'{lens}, {mount}', mount=mount, camera=camera)


STARTS, QUICK_STARTS = 64, 8
LONGEST_S = 180.0  # of a run: with a level camera it takes 35 s
GROUPS = {
    'attitude': 'tilt (down positive) and roll (clockwise)',
    'yaw': 'yaw (left positive) and place, ahead and left of the axle',
    'worse': 'worse, with a right wheel 1 % larger',
    'size': 'image size [px], field of view 79.5 deg',
    'lens': 'lens',
}
COLUMNS: Columns = {
    **ARRIVALS,
    'excursion, p95 / max': lambda row: numbers((row['excursion'][q] for q in ('p95', 'max')), 2),
    'wrong geometry, max [s]': lambda row: number(row['wrong_geometry_s']['max'], 1),
    **TIME,
}


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Drive each mount, image size and lens from the same starts."""
    return drive(on_features(quick=quick), QUICK_STARTS if quick else STARTS, seed=seed, say=say)


def drive(
    cells: Iterable[MountCell], starts: int, *, seed: int, say: Callable[[str], None]
) -> dict[str, Any]:
    """Return the document of ``cells``: a row each."""
    rows = [
        (asdict(cell), sweep('front', starts, 'full', cell.scenario(LONGEST_S), seed))
        for cell in cells
    ]
    return measure(rows, say, region='front', starts=starts, seed=seed, longest_s=LONGEST_S)


def table(document: Mapping[str, Any]) -> str:
    """Return the document as Markdown: a line that says what was done, then a table a group."""
    lines = [
        f'{document["starts"]} starts in `{document["region"]}`, the same for each camera, '
        f'point features at 0.2 px, at most {document["longest_s"]:g} s a run; the servo is '
        f'not given the mount. Seed {document["seed"]}, commit {document["commit"]}.',
        'Errors of the runs that arrived; excursion (largest distance over the first) and the '
        'time driven on bearings more than 10 deg wrong of all runs.',
    ]
    for group, title in GROUPS.items():
        rows = [row for row in document['rows'] if row['group'] == group]
        if rows:
            columns = {title: lambda row: str(row['name']), **COLUMNS}
            lines += ['', *markdown(' | '.join(columns), cells(columns, rows))]
    return '\n'.join(lines)
