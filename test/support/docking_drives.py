"""Drives past a photograph with odometry that drifts, for what is found out on the way."""

from collections.abc import Iterator
from dataclasses import dataclass
import math

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.docking.pose import DockPoseSettings, DockSearch, update_search
from visual_servo_epipolar.core.geometry.motion import (
    HALF_PI,
    integrate,
    inverse_pose,
    Pose,
    Twist,
)
from visual_servo_epipolar.core.odometry.path import Path
from visual_servo_epipolar.core.twoview.observation import observe
from visual_servo_epipolar.simulation.point_world import PointSettings, PointWorld
from visual_servo_epipolar.simulation.rigs import CameraMount, SimulatedRig

CAMERA = Camera(1280, 1024, 769.2, 769.2, 635.0, 512.0)
PERIOD_S, PERIOD_NS = 0.2, 200_000_000
NOISE = 0.0075  # of the odometry, a metre and a radian
EXACT = {f'camera_{name}_deviation': 1e-4 for name in ('yaw', 'forward', 'left')}


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A start, a speed and the turns on the way; ``mount`` is that of the camera."""

    start: tuple[float, float, float]
    seed: int = 0
    linear: float = 0.4
    angular: float = 0.0
    mount: CameraMount = CameraMount()
    points: PointSettings = PointSettings()
    odometry_noise: float = NOISE

    def searched(
        self, settings: DockPoseSettings, frames: int
    ) -> Iterator[tuple[DockSearch, Pose]]:
        """Yield the search and the true pose, frame by frame."""
        rng = np.random.default_rng((self.seed, 9))
        world = PointWorld(self.points, SimulatedRig(CAMERA, self.mount), seed=self.seed)
        pose, told = Pose.from_start(*self.start), Pose(0.0, 0.0, 0.0)
        path, search = Path(), DockSearch()
        for frame in range(frames):
            stamp_ns = frame * PERIOD_NS
            path.add_pose(stamp_ns, told)
            seen = observe(world.observe(pose, frame), CAMERA, stamp_ns)
            place = path.at(stamp_ns)
            assert place is not None
            search = update_search(search, seen, place, settings)
            yield search, pose
            angular = self.angular * math.cos(0.35 * frame)
            pose = integrate(pose, Twist(self.linear, angular), PERIOD_S)
            told = integrate(told, self._measured(angular, rng), PERIOD_S)

    def _measured(self, angular: float, rng: np.random.Generator) -> Twist:
        """Return the velocity as odometry has it: way and heading walk at random."""
        way, turn = abs(self.linear) * PERIOD_S, abs(angular) * PERIOD_S
        along = self.odometry_noise * math.sqrt(way) * rng.standard_normal()
        about = self.odometry_noise * math.sqrt(way + turn) * rng.standard_normal()
        return Twist(self.linear + along / PERIOD_S, angular + about / PERIOD_S)


def true_dock(pose: Pose) -> FloatArray:
    """Return where the dock is from a base at ``pose``: x forward, y left [m], turn [rad]."""
    dock = inverse_pose(np.array([pose.y, -pose.x, pose.theta - HALF_PI]))
    dock[2] = math.remainder(dock[2], 2.0 * math.pi)
    return dock
