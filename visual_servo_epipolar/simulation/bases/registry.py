"""Bases by the name that a scenario gives them: a new one is a file of its own and a row here."""

from dataclasses import fields
from typing import NamedTuple

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.settings import Settings
from visual_servo_epipolar.simulation.bases.ackermann import Ackermann, AckermannSettings
from visual_servo_epipolar.simulation.bases.pioneer import Pioneer, PioneerSettings
from visual_servo_epipolar.simulation.bases.simulated_base import (
    SimulatedBase,
    SimulatedBaseFactory,
)


class SimulatedBaseModel(NamedTuple):
    """One row: the class of settings, which no other row has, and who makes the base."""

    settings: type[Settings]
    factory: SimulatedBaseFactory


SIMULATED_BASES: dict[str, SimulatedBaseModel] = {
    'pioneer': SimulatedBaseModel(PioneerSettings, Pioneer),
    'ackermann': SimulatedBaseModel(AckermannSettings, Ackermann),
}


def base_name(settings: Settings) -> str:
    """Return the name of the base that ``settings`` belong to; KeyError if there is none."""
    return {model.settings: name for name, model in SIMULATED_BASES.items()}[type(settings)]


def model_settings(name: str, values: Settings) -> Settings:
    """Return the settings of the base called ``name``, of those ``values`` which it has."""
    kind = SIMULATED_BASES[name].settings
    return kind(**{item.name: getattr(values, item.name) for item in fields(kind)})


def new_base(settings: Settings, pose: Pose, *, seed: int, now_ns: int = 0) -> SimulatedBase:
    """Return the base that ``settings`` describe, at ``pose`` and time ``now_ns`` [ns]."""
    return SIMULATED_BASES[base_name(settings)].factory(settings, pose, seed=seed, now_ns=now_ns)
