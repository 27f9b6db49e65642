"""Scenarios: the settings of all parts of a run, read from YAML."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import yaml

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import setting, Settings, updated
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.simulation.bases.pioneer import PioneerSettings
from visual_servo_epipolar.simulation.bases.registry import base_name, BaseModel, BASES
from visual_servo_epipolar.simulation.closed_loop import LoopSettings
from visual_servo_epipolar.simulation.disturbances.image import DisturbanceSettings
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.mounts.registry import rig_name, RigModel, RIGS
from visual_servo_epipolar.simulation.point_world import PointSettings


@dataclass(frozen=True, kw_only=True)
class RunSettings(Settings):
    """What belongs to the run as a whole."""

    max_duration: float = setting(300.0, 'Longest run, simulated time [s]', low=1.0, high=36000.0)


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """Settings of every part of a simulated run; the defaults are the nominal scenario."""

    run: RunSettings = field(default_factory=RunSettings)
    base: Settings = field(default_factory=PioneerSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    points: PointSettings = field(default_factory=PointSettings)
    disturbances: DisturbanceSettings = field(default_factory=DisturbanceSettings)
    tracker: TrackerSettings = field(default_factory=TrackerSettings)
    servo: ServoSettings = field(default_factory=ServoSettings)

    def document(self) -> dict[str, Any]:
        """Return all settings by section, and by name which base and which camera rig they are."""
        sections = asdict(self)
        sections['base']['model'] = base_name(self.base)
        sections['camera']['rig'] = rig_name(self.camera)
        return sections

    def seeded(self, seed: int) -> 'Scenario':
        """Return the scenario with noise, jitter and random subsets drawn from ``seed``."""
        return replace(
            self,
            camera=replace(self.camera, seed=seed),
            servo=replace(self.servo, seed=seed),
        )

    def with_servo(self, changes: Mapping[str, Any]) -> 'Scenario':
        """Return the scenario with servo settings changed; raises InputError for a bad one."""
        try:
            return replace(self, servo=updated(self.servo, changes, 'servo'))
        except ValueError as error:
            raise InputError(str(error)) from None

    def loop(self, start: tuple[float, float, float], seed: int) -> LoopSettings:
        """Return the settings of one run from ``start``: x [m], y [m], heading error [deg]."""
        return LoopSettings(
            start=start,
            seed=seed,
            frame_rate=self.camera.frame_rate,
            max_duration=self.run.max_duration,
            servo=self.servo,
            base=self.base,
        )


# Sections that come in several kinds: the key that names the kind, and settings by its name.
KINDS: Mapping[str, tuple[str, Mapping[str, BaseModel | RigModel]]] = {
    'base': ('model', BASES),
    'camera': ('rig', RIGS),
}


def from_document(document: Any, where: str) -> Scenario:
    """
    Build a scenario from a parsed YAML document: sections of settings, all optional.

    ``model`` in the section ``base`` and ``rig`` in the section ``camera`` say which one it is;
    its settings are the others of that section.

    Raises
    ------
    InputError
        If a section or a setting is unknown, of a wrong type, or out of range.

    """
    if document is None:
        document = {}
    if not isinstance(document, Mapping):
        raise InputError(f'{where}: a scenario must map sections to settings, got {document!r}')
    names = [item.name for item in fields(Scenario)]
    unknown = sorted(str(key) for key in document if key not in names)
    if unknown:
        raise InputError(
            f'{where}: no section {", ".join(unknown)}; a scenario has {", ".join(names)}'
        )
    try:
        sections: dict[str, Any] = {
            name: _section(name, {} if values is None else values, f'{where}: {name}')
            for name, values in document.items()
        }
    except ValueError as error:
        raise InputError(str(error)) from None
    return replace(Scenario(), **sections)


def _section(name: str, values: Any, where: str) -> Settings:
    """Return the settings of one section; raises ValueError for a bad one."""
    settings: Settings = getattr(Scenario(), name)
    if name in KINDS and isinstance(values, Mapping):
        key, models = KINDS[name]
        kind, values = values.get(key), {k: v for k, v in values.items() if k != key}
        if kind is not None and kind not in tuple(models):
            raise ValueError(f'{where}: {key} must be one of {", ".join(models)}, got {kind!r}')
        settings = settings if kind is None else models[kind].settings()
    return updated(settings, values, where)


def load(path: Path) -> Scenario:
    """Read a scenario file; raises InputError if it cannot be read or used."""
    try:
        document = yaml.safe_load(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f'{path}: scenario cannot be read: {error}') from None
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f'{path}: scenario is not YAML: {" ".join(str(error).split())}') from None
    return from_document(document, str(path))
