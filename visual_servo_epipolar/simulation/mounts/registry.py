"""Camera rigs by the name that a scenario gives them: a new one is a new file and a row here."""

from collections.abc import Callable
from dataclasses import fields
from typing import Any, NamedTuple

from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.mounts.fixed import fixed_rig
from visual_servo_epipolar.simulation.mounts.pan_tilt import pan_tilt_rig, PanTiltSettings
from visual_servo_epipolar.simulation.mounts.simulated_head import HeadSettings
from visual_servo_epipolar.simulation.mounts.simulated_rig import SimulatedRig


class SimulatedRigModel(NamedTuple):
    """One row: the class of settings, which no other row has, and who makes the rig of them."""

    settings: type[CameraSettings]
    factory: Callable[[Any], SimulatedRig]


SIMULATED_RIGS: dict[str, SimulatedRigModel] = {
    'fixed': SimulatedRigModel(CameraSettings, fixed_rig),
    'pan_tilt': SimulatedRigModel(PanTiltSettings, pan_tilt_rig),
}


def rig_name(settings: CameraSettings) -> str:
    """Return the name of the rig that ``settings`` belong to; KeyError if there is none."""
    return {model.settings: name for name, model in SIMULATED_RIGS.items()}[type(settings)]


def carried(name: str, camera: CameraSettings, head: HeadSettings) -> CameraSettings:
    """Return the settings of a ``camera`` on the rig of that name; ValueError if there is none."""
    if name not in SIMULATED_RIGS:
        raise ValueError(f'rig must be one of {", ".join(SIMULATED_RIGS)}, got {name!r:.40}')
    kind = SIMULATED_RIGS[name].settings
    values = {item.name: getattr(head, item.name) for item in fields(head)}
    values |= {item.name: getattr(camera, item.name) for item in fields(camera)}
    return kind(**{item.name: values[item.name] for item in fields(kind)})


def head_settings(settings: CameraSettings) -> HeadSettings | None:
    """Return what the head is like that turns the camera; None of a rig without one."""
    return settings if isinstance(settings, HeadSettings) else None


def new_rig(settings: CameraSettings) -> SimulatedRig:
    """Return the rig that ``settings`` describe."""
    return SIMULATED_RIGS[rig_name(settings)].factory(settings)
