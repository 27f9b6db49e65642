"""Bases by the names that settings give them, and those of other packages."""

from visual_servo_epipolar.core.bases.base import Base, BaseFactory, BaseLimits
from visual_servo_epipolar.core.bases.car import Car
from visual_servo_epipolar.core.bases.differential_drive import DifferentialDrive
from visual_servo_epipolar.core.registry import Registry

DEFAULT_BASE = 'differential_drive'
BASES: Registry[BaseFactory] = Registry(
    'visual_servo_epipolar.bases', {DEFAULT_BASE: DifferentialDrive, 'car': Car}
)


def base_of(name: str, limits: BaseLimits) -> Base:
    """Return the base of that ``name``; ValueError if there is none."""
    if name not in BASES:
        raise ValueError(
            f'base must be one of {", ".join(BASES)}, got {name!r:.40}; '
            f'install the package that brings it under the entry point {BASES.group}'
        )
    return BASES[name](limits)
