"""Camera rigs by the name that a scenario gives them: a new one is a new file and a row here."""

from collections.abc import Callable
from typing import Any, NamedTuple

from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.mounts.fixed import fixed_rig
from visual_servo_epipolar.simulation.mounts.simulated_rig import SimulatedRig


class SimulatedRigModel(NamedTuple):
    """One row: the class of settings, which no other row has, and who makes the rig of them."""

    settings: type[CameraSettings]
    factory: Callable[[Any], SimulatedRig]


SIMULATED_RIGS: dict[str, SimulatedRigModel] = {
    'fixed': SimulatedRigModel(CameraSettings, fixed_rig)
}


def rig_name(settings: CameraSettings) -> str:
    """Return the name of the rig that ``settings`` belong to; KeyError if there is none."""
    return {model.settings: name for name, model in SIMULATED_RIGS.items()}[type(settings)]


def new_rig(settings: CameraSettings) -> SimulatedRig:
    """Return the rig that ``settings`` describe."""
    return SIMULATED_RIGS[rig_name(settings)].factory(settings)
