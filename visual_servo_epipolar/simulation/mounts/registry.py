"""Camera rigs by the name that a scenario gives them: a new one is a new file and a row here."""

from collections.abc import Callable
from dataclasses import fields
from typing import Any, NamedTuple

from visual_servo_epipolar.core.settings import Settings
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.mounts.pan_tilt import (
    HeadSettings,
    pan_tilt_rig,
    PanTiltSettings,
)
from visual_servo_epipolar.simulation.mounts.simulated_rig import SimulatedRig


class SimulatedRigModel(NamedTuple):
    """
    One row: the class of settings, which no other row has, and the function that makes the rig.

    ``turns`` tells that joints turn the camera.
    """

    settings: type[CameraSettings]
    factory: Callable[[Any], SimulatedRig]
    turns: bool = True


SIMULATED_RIGS: dict[str, SimulatedRigModel] = {
    'fixed': SimulatedRigModel(CameraSettings, CameraSettings.fixed_rig, turns=False),
    'pan_tilt': SimulatedRigModel(PanTiltSettings, pan_tilt_rig),
}


def rig_name(settings: CameraSettings) -> str:
    """Return the name of the rig that ``settings`` belong to; KeyError if there is none."""
    return {model.settings: name for name, model in SIMULATED_RIGS.items()}[type(settings)]


def turns(settings: CameraSettings) -> bool:
    """Return whether joints turn the camera that ``settings`` belong to."""
    return SIMULATED_RIGS[rig_name(settings)].turns


def rig_settings(name: str, *parts: Settings) -> CameraSettings:
    """Return the settings of the rig of that ``name``, as far as it has those of the ``parts``."""
    kind = SIMULATED_RIGS[name].settings
    values = {item.name: getattr(part, item.name) for part in parts for item in fields(part)}
    return kind(**{item.name: values[item.name] for item in fields(kind)})


def head_settings(settings: CameraSettings) -> HeadSettings | None:
    """Return what the head is like that turns the camera; None of a rig without one."""
    return settings if isinstance(settings, HeadSettings) else None


def new_rig(settings: CameraSettings) -> SimulatedRig:
    """Return the rig that ``settings`` describe."""
    return SIMULATED_RIGS[rig_name(settings)].factory(settings)
