"""World of the tracking benchmark: approaches to the goal, and true places of features."""

from dataclasses import dataclass, replace
import math

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray, Image
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.simulation.disturbances import Disturbances
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.mounts.mounting import CameraMount, FixedRig
from visual_servo_epipolar.simulation.mounts.sensor import DESIRED_FRAME, Sensor, SensorSettings
from visual_servo_epipolar.simulation.rendering.renderer import Renderer
from visual_servo_epipolar.simulation.rooms.scene import room

STANDING = 5  # last frames, at the goal
BRAKING = 20  # frames before those
RINGS = (3, 6, 10)  # how far from a feature depth is examined [px]
DIRECTIONS = np.array([(1, 0), (0, 1), (1, 1), (1, -1)])
DEPTH_STEP = 0.02  # bend of inverse depth that is an edge, relative
NUDGE = 1e-4  # of the pose, for its derivatives [m, rad]


def approach(start: tuple[float, float], frames: int) -> list[Pose]:
    """
    Return poses from ``start``, (x, y) [m], to the goal, the last ``STANDING`` of them at it.

    Along x = x0 (y / y0)^2, looking along the path: it arrives looking along +y. The speed is
    constant until the robot brakes.
    """
    x, y = start
    pace = np.clip(np.arange(frames - STANDING)[::-1] / BRAKING, 0.0, 1.0)
    remaining = 1.0 - np.cumsum(pace) / pace.sum()
    remaining = np.concatenate([remaining, np.zeros(STANDING)]).tolist()
    headings = [math.atan2(-y, -2.0 * x * share) for share in remaining]
    return [
        Pose(x * share**2, y * share, heading)
        for share, heading in zip(remaining, headings, strict=True)
    ]


def start_of(seed: int, frames: int) -> tuple[float, float]:
    """Return a start (x, y) [m] 3 to 5.5 m behind the goal; nearer when there are few frames."""
    rng = np.random.default_rng((seed, 6))
    side = -1.0 if rng.random() < 0.5 else 1.0
    shorter = min(1.0, frames / 200.0)
    return side * rng.uniform(0.3, 0.6) * shorter, -rng.uniform(3.0, 5.5) * shorter


class RenderedWorld:
    """A room and a camera in it: perfect images, images of the sensor, and ground truth."""

    def __init__(self, settings: CameraSettings) -> None:
        self.settings = settings
        mount = CameraMount(settings.mount_height, settings.mount_forward)
        rig = FixedRig(settings.camera, mount)
        self.renderer = Renderer(room(settings.scene_seed), rig)
        self.size = settings.width, settings.height
        sensor = SensorSettings(noise=settings.noise, gain_drift=settings.gain_drift)
        self._sensor = Sensor(self.size, sensor, settings.seed)
        self.truth = TrueFeatures(self.renderer)

    def photograph(self) -> Image:
        """Return the desired image, shape (H, W)."""
        return self._sensor.capture(self.renderer.render(DESIRED_POSE), DESIRED_FRAME)

    def capture(self, perfect: Image, frame: int, disturbances: Disturbances | None) -> Image:
        """Return ``perfect``, shape (H, W), through ``disturbances`` and the sensor."""
        if disturbances is not None:
            perfect = disturbances.apply(perfect, frame)
        return self._sensor.capture(perfect, frame)


@dataclass(frozen=True, slots=True, eq=False)
class FrameErrors:
    """
    Errors of the features of one frame, rows are features.

    ``shift``, shape (N, 2): from the feature to where it is tracked [px]; infinite
    for a point behind the camera. ``clearance``: distance from the next edge of depth in the
    desired image [px], one of RINGS, or infinite. ``visible``: its point is in the image and
    nothing in the room hides it; ``covered``: a disturbance does.
    """

    features: Features
    shift: FloatArray
    clearance: FloatArray
    visible: BoolArray
    covered: BoolArray

    @property
    def distances(self) -> FloatArray:
        """Distance of each feature from its true place [px], shape (N,)."""
        return np.asarray(np.hypot(self.shift[:, 0], self.shift[:, 1]))

    @property
    def on_edge(self) -> BoolArray:
        """Which features, shape (N,), sit on an edge of depth: they have no single true place."""
        return np.asarray(self.clearance <= RINGS[0])

    @property
    def trackable(self) -> BoolArray:
        """Which features, shape (N,), can be tracked: off edges, visible, and not covered."""
        return np.asarray(~self.on_edge & self.visible & ~self.covered)


class TrueFeatures:
    """Ground truth: where the features of the desired view are, by the geometry of the room."""

    def __init__(self, renderer: Renderer) -> None:
        self._renderer = renderer
        self._points: dict[tuple[float, float], tuple[FloatArray, float]] = {}

    def errors(
        self, features: Features, pose: Pose, disturbances: Disturbances | None, frame: int
    ) -> FrameErrors:
        """Return the errors of ``features``, tracked from ``pose`` in ``frame``."""
        points, clearance = self.points(features.desired)
        pixels, inside = self._renderer.project(points, pose)
        ahead = np.asarray(np.isfinite(pixels).all(axis=1))
        shift = np.where(ahead[:, None], features.current - np.nan_to_num(pixels), np.inf)
        visible = inside.copy()
        visible[inside] = self._renderer.unhidden(points[inside], pixels[inside], pose)
        covered = np.zeros(len(features), bool)
        if disturbances is not None:
            covered = disturbances.hides(pixels, frame)
        return FrameErrors(features, shift, clearance, visible, covered)

    def points(self, desired: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the points [m], (N, 3), of desired pixels, (N, 2), and their clearances, (N,)."""
        keys = [(float(u), float(v)) for u, v in desired]
        new = [key for key in dict.fromkeys(keys) if key not in self._points]
        if new:
            pixels = np.array(new)
            traced = self._renderer.trace(pixels, DESIRED_POSE)
            clearance = self._clearance(pixels).tolist()
            for key, point, space in zip(new, traced, clearance, strict=True):
                self._points[key] = point, space
        points = np.array([self._points[key][0] for key in keys]).reshape(-1, 3)
        return points, np.array([self._points[key][1] for key in keys])

    def pose_error(self, frame_errors: FrameErrors) -> tuple[float, float, float] | None:
        """
        Return the shift of the goal, x, y [m] and heading [rad], that explains the errors best.

        Least squares over all trackable features, gross errors too; None for fewer than three.
        """
        rows = frame_errors.trackable
        if int(rows.sum()) < 3:
            return None
        points, _ = self.points(frame_errors.features.desired[rows])
        columns = []
        for name, value in (('x', 0.0), ('y', 0.0), ('theta', DESIRED_POSE.theta)):
            ahead, behind = (
                self._renderer.project(points, replace(DESIRED_POSE, **{name: value + nudge}))[0]
                for nudge in (NUDGE, -NUDGE)
            )
            columns.append(((ahead - behind) / (2.0 * NUDGE)).ravel())
        shift = frame_errors.shift[rows].ravel()
        solution = np.linalg.lstsq(np.stack(columns, 1), shift, rcond=None)[0]
        return float(solution[0]), float(solution[1]), float(solution[2])

    def _clearance(self, pixels: FloatArray) -> FloatArray:
        """Return the smallest ring around each pixel on which the depth is not smooth."""
        clearance = np.full(len(pixels), np.inf)
        here = self._inverse_depth(pixels)
        for ring in sorted(RINGS, reverse=True):
            for step in ring * DIRECTIONS:
                both = self._inverse_depth(pixels + step) + self._inverse_depth(pixels - step)
                # Of a plane, inverse depth is linear in the pixel. NaN, no surface, is an edge.
                smooth = np.abs(both - 2.0 * here) <= DEPTH_STEP * here
                clearance[~smooth] = ring
        return clearance

    def _inverse_depth(self, pixels: FloatArray) -> FloatArray:
        axes, centre = self._renderer.rig.camera_pose(DESIRED_POSE)
        away = self._renderer.trace(pixels, DESIRED_POSE) - centre
        return np.asarray(1.0 / (away @ axes[:, 2]))
