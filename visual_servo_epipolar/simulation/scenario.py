"""Scenarios: what is perturbed in a run, read from YAML."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import yaml

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import setting, Settings, updated
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.simulation.bases.pioneer import BaseSettings
from visual_servo_epipolar.simulation.camera_simulator import CameraSettings
from visual_servo_epipolar.simulation.closed_loop import LoopSettings
from visual_servo_epipolar.simulation.disturbances.image import DisturbanceSettings
from visual_servo_epipolar.simulation.point_world import PointSettings


@dataclass(frozen=True, kw_only=True)
class RunSettings(Settings):
    """What belongs to the run as a whole."""

    max_duration: float = setting(300.0, 'Longest run, simulated time [s]', low=1.0, high=36000.0)


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """Settings of every part of a simulated run; the defaults are the nominal scenario."""

    run: RunSettings = field(default_factory=RunSettings)
    base: BaseSettings = field(default_factory=BaseSettings)
    camera: CameraSettings = field(default_factory=CameraSettings)
    points: PointSettings = field(default_factory=PointSettings)
    disturbances: DisturbanceSettings = field(default_factory=DisturbanceSettings)
    tracker: TrackerSettings = field(default_factory=TrackerSettings)
    servo: ServoSettings = field(default_factory=ServoSettings)

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
        """Return the settings of one run from ``start``."""
        return LoopSettings(
            start=start,
            seed=seed,
            frame_rate=self.camera.frame_rate,
            max_duration=self.run.max_duration,
            servo=self.servo,
            base=self.base,
        )


def from_document(document: Any, where: str) -> Scenario:
    """
    Build a scenario from a parsed YAML document: sections of settings, all optional.

    Raises
    ------
    InputError
        If a section or a setting is unknown, of a wrong type, or out of range.

    """
    if document is None:
        document = {}
    if not isinstance(document, Mapping):
        raise InputError(f'{where}: a scenario must map sections to settings, got {document!r}')
    known = [item.name for item in fields(Scenario)]
    unknown = sorted(str(key) for key in document if key not in known)
    if unknown:
        raise InputError(
            f'{where}: no section {", ".join(unknown)}; a scenario has {", ".join(known)}'
        )
    scenario = Scenario()
    try:
        changes = {
            name: updated(
                getattr(scenario, name), {} if values is None else values, f'{where}: {name}'
            )
            for name, values in document.items()
        }
    except ValueError as error:
        raise InputError(str(error)) from None
    return replace(scenario, **changes)


def load(path: Path) -> Scenario:
    """Read a scenario file; raises InputError if it cannot be read or used."""
    try:
        document = yaml.safe_load(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f'{path}: scenario cannot be read: {error}') from None
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f'{path}: scenario is not YAML: {" ".join(str(error).split())}') from None
    return from_document(document, str(path))
