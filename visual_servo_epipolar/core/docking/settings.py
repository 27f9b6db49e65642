"""Settings of docking: of the dock's pose along the driven path, and of a request to dock."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
import math
from typing import Any, ClassVar

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.mapping.window import MapSettings
from visual_servo_epipolar.core.rigs.fixed_mount import Mount
from visual_servo_epipolar.core.settings import fixed, internal, setting, Settings
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings

LAG = 0.002  # by which images and odometry may be apart [m]: their stamps are of one clock


@dataclass(frozen=True, kw_only=True)
class DockPoseSettings(PerceptionSettings):
    """
    Settings of the dock's pose: those of perception, and its own.

    Angles in rad, lengths in m.
    """

    INTERNAL: ClassVar[frozenset[str]] = frozenset(
        'estimator focal_deviation readout camera_tilt camera_roll camera_tilt_deviation '
        'camera_roll_deviation'.split()
    )
    GONE: ClassVar[Mapping[str, Any]] = {
        'camera_left_deviation': 0.02,
        'path_scale_deviation': 0.01,
        'key_views': 10,
        'key_travel': 0.05,
        'key_turn': 0.1,
    }

    camera_yaw: float = fixed(
        0.0,
        'Yaw of the camera on the base, to the left, as configured; beyond 1.57 it looks back, '
        'and dock_robot docks backward [rad]',
        low=-3.15,
        high=3.15,
    )
    camera_forward: float = fixed(
        0.0, 'Camera ahead of the axle, as configured [m]', low=-2.0, high=2.0
    )
    camera_left: float = fixed(
        0.0, 'Camera to the left of the middle of the axle, as configured [m]', low=-2.0, high=2.0
    )
    camera_yaw_deviation: float = internal(0.02, 'Deviation of that yaw [rad]', low=0.0, high=0.5)
    camera_forward_deviation: float = internal(
        0.02, 'Deviation of those offsets [m]', low=0.0, high=1.0
    )
    path_deviation: float = setting(
        0.01,
        'Deviation of the scale of the driven way: of a metre by odometry [m]',
        low=1e-4,
        high=1.0,
    )
    publish_deviation: float = setting(
        0.05,
        'Largest standard deviation of the position that is published [m]',
        low=1e-4,
        high=10.0,
    )
    publish_heading: float = internal(
        0.02, 'Deviation of the heading below which it is published [rad]', low=1e-4, high=3.0
    )

    @property
    def mount_is_told(self) -> bool:
        """Whether any setting says how the camera is mounted."""
        return bool(self.camera_place.any() or self.camera_tilt or self.camera_roll)

    @property
    def looks_back(self) -> bool:
        """Whether the camera looks back, and the robot docks backward."""
        return abs(self.camera_yaw) > 0.5 * math.pi

    def mounted(self, mount: Mount) -> 'DockPoseSettings':
        """Return the settings of a camera mounted as in a description of the robot."""
        configured = {f'camera_{item.name}': getattr(mount, item.name) for item in fields(mount)}
        return replace(self, **configured)

    @property
    def camera_place(self) -> FloatArray:
        """Place of the camera on the base as configured, (3,): forward, left [m], yaw [rad]."""
        return np.array([self.camera_forward, self.camera_left, self.camera_yaw])

    @property
    def map(self) -> MapSettings:
        """Bounds of the map, whose scale is that of the path."""
        return MapSettings(scale_deviation=self.path_deviation, lag=LAG)


@dataclass(frozen=True, kw_only=True)
class DockTaskSettings(Settings):
    """Settings of the action dock_robot: names as docking_server has them."""

    GONE: ClassVar[Mapping[str, Any]] = {'dock_type': ''}

    dock_id: str = fixed('', 'Name of the dock of the photograph; empty: that of every request')
    max_retries: int = internal(3, 'Further attempts after one that failed', low=0, high=100)
    initial_perception_timeout: float = internal(
        5.0, 'Longest wait for the photograph to be seen [s]', low=0.1, high=600.0
    )
    dock_approach_timeout: float = internal(
        300.0, 'Longest approach in one attempt [s]', low=1.0, high=86400.0
    )
    servo_timeout: float = internal(
        5.0, 'Longest silence of the servo while it should drive [s]', low=0.2, high=600.0
    )
    wait_for_charge: bool = fixed(False, 'Docked means charging (battery_state); false: arrived')
    charging_threshold: float = internal(
        0.5, 'Current of battery_state above which it charges [A]', low=0.0, high=1000.0
    )
    wait_charge_timeout: float = internal(
        5.0, 'Longest wait at the dock for that current [s]', low=0.1, high=600.0
    )
