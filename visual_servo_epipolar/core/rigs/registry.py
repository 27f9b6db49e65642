"""Rigs by the names that settings give them, and those of other packages."""

from visual_servo_epipolar.core.registry import Registry
from visual_servo_epipolar.core.rigs.fixed_mount import FixedMount
from visual_servo_epipolar.core.rigs.pan_tilt import PanTiltHead
from visual_servo_epipolar.core.rigs.rig import HeadLimits, Rig, RigFactory

DEFAULT_RIG = 'fixed'
RIGS: Registry[RigFactory] = Registry(
    'visual_servo_epipolar.rigs',
    {DEFAULT_RIG: lambda limits: FixedMount(), 'pan_tilt': PanTiltHead},
)


def rig_of(name: str, limits: HeadLimits) -> Rig:
    """Return the rig of that ``name``; ValueError if there is none."""
    if name not in RIGS:
        raise ValueError(
            f'rig must be one of {", ".join(RIGS)}, got {name!r:.40}; '
            f'install the package that brings it under the entry point {RIGS.group}'
        )
    return RIGS[name](limits)
