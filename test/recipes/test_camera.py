"""Recipe of a camera: another package brings a panorama, and the servo drives with it."""

from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.registry import CameraRow
from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.simulation.scenario import from_document
from visual_servo_epipolar.simulation.views import drive

LOWEST = 0.6  # cosine of the elevation that its mirror shows at least


@dataclass(frozen=True, slots=True)
class Panorama(CameraModel):
    """All bearings in one row: u goes with the bearing, v with the elevation."""

    distortion_model: str = 'panorama'

    lens = 'panorama'
    wide = wraps = True
    planar = None
    edges = (-math.inf, math.inf)

    def rays(self, pixels: FloatArray) -> FloatArray:
        bearing = (pixels[:, 0] - self.cx) / self.fx
        elevation = (pixels[:, 1] - self.cy) / self.fy
        level = np.cos(elevation)
        columns = level * np.sin(bearing), np.sin(elevation), level * np.cos(bearing)
        return np.column_stack(columns)

    def pixels(self, rays: FloatArray) -> FloatArray:
        bearing = np.arctan2(rays[:, 0], rays[:, 2])
        elevation = np.arcsin(np.clip(rays[:, 1], -1.0, 1.0))
        return np.column_stack([self.fx * bearing + self.cx, self.fy * elevation + self.cy])

    def round_trips(self, pixels: FloatArray, rays: FloatArray) -> BoolArray:
        return np.asarray(np.isfinite(rays).all(axis=1))

    def resolution(self, rays: FloatArray) -> FloatArray:
        level = np.hypot(rays[:, 0], rays[:, 2])
        return np.asarray(np.sqrt(np.maximum(level, LOWEST)) / self.focal)

    def contains(self, pixels: FloatArray, *, margin: float = 0.0) -> BoolArray:
        v = pixels[:, 1]
        return np.asarray((v >= margin) & (v <= self.height - 1 - margin))


PANORAMA = CameraRow(Panorama)


def test_the_servo_drives_by_a_camera_of_another_package(install) -> None:
    install('cameras', 'panorama', f'{__name__}:PANORAMA')
    camera = {
        'distortion_model': 'panorama',
        'width': 1600,
        'height': 400,
        'focal_length': 1600 / math.tau,
        'principal_u': 799.5,
        'principal_v': 199.5,
    }
    scenario = from_document({'camera': camera}, 'test')
    # Turned away by 100 deg: no other lens would see the goal's features.
    result = summarise(drive(scenario, (0.5, -3.0, 100.0), 2))
    assert result['outcome'] == 'arrived', result['reason']
    assert result['position_error_m'] < 0.01
