"""The dock's pose in metres: the map that the servo makes, at the scale of the driven path."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
import math
from typing import Any, ClassVar

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimate.goal_estimate import in_base
from visual_servo_epipolar.core.estimate.map_state import (
    agrees,
    filter_pose,
    FilteredPose,
    LEAST_NOISE,
    PLACE,
)
from visual_servo_epipolar.core.geometry.motion import (
    compose,
    inverse_pose,
    motion_between,
    Pose,
    relative_pose,
)
from visual_servo_epipolar.core.goal import Goal, NO_GOAL
from visual_servo_epipolar.core.mapping.factors import camera_poses
from visual_servo_epipolar.core.mapping.keyframe_map import KeyframeMap
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.core.mapping.refinement import Geometry
from visual_servo_epipolar.core.mapping.window import (
    FeatureObservations,
    HEADING,
    MapSettings,
    VIEW,
)
from visual_servo_epipolar.core.odometry.increments import Motion
from visual_servo_epipolar.core.odometry.path import PathPlace
from visual_servo_epipolar.core.rigs.fixed_mount import Mount
from visual_servo_epipolar.core.settings import fixed, internal, setting
from visual_servo_epipolar.core.twoview.memory import PerceptionMemory
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.perceive import perceive, Perception
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings
from visual_servo_epipolar.core.twoview.validation import noise_learnt

MOST_CONTRADICTIONS = 8  # in a row: then all is begun anew
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
        'Yaw of the camera on the base, to the left, as configured; beyond 1.57 it looks back '
        '[rad]',
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


@dataclass(frozen=True, slots=True, eq=False)
class DockPose:
    """
    Pose of the dock in axes of the base at ``stamp_ns``: x forward, y left [m], turn [rad].

    The dock is the base as it stood at the photograph. ``covariance``, (3, 3), is of all three.
    """

    stamp_ns: int
    pose: FloatArray
    covariance: FloatArray

    @property
    def deviation(self) -> float:
        """Deviation of the place along its worst direction [m]."""
        return math.sqrt(max(float(np.linalg.eigvalsh(self.covariance[:2, :2])[-1]), 0.0))

    @property
    def heading_deviation(self) -> float:
        """Deviation of the heading [rad]."""
        return math.sqrt(max(float(self.covariance[2, 2]), 0.0))


@dataclass(frozen=True, eq=False)
class DockSearch:
    """
    Search for the dock along the driven path; a new one begins from ``DockSearch()``.

    ``map`` is the servo's, of photograph ``goal``, with what was driven up to ``mapped``;
    ``place`` the base in it at ``last``. ``estimate`` follows from it; for a ``reason`` it is not
    to be published.
    """

    map: KeyframeMap | None = None
    place: FilteredPose | None = None
    last: PathPlace | None = None
    mapped: PathPlace | None = None
    goal: int = NO_GOAL
    memory: PerceptionMemory | None = None
    frame: int = 0
    contradictions: int = 0
    estimate: DockPose | None = None
    reason: str = 'nothing was seen yet'

    @property
    def dock(self) -> DockPose | None:
        """The pose that may be published, or None."""
        return None if self.reason else self.estimate


def update_search(
    search: DockSearch,
    observation: Observation,
    place: PathPlace,
    settings: DockPoseSettings,
    *,
    goal: int = NO_GOAL,
) -> DockSearch:
    """Return the search after an ``observation`` of photograph ``goal`` from a ``place``."""
    if Goal(search.goal).differs(goal) or (search.last and search.last.epoch != place.epoch):
        search = DockSearch(frame=search.frame)
    perception = perceive(observation, settings, search.frame, search.memory)
    memory, frame = noise_learnt(perception.memory), search.frame + 1
    before, motion = search.place, _motion(search.last or place, place)
    at = None if before is None else before.after(motion)
    search = replace(search, memory=memory, frame=frame, place=at, last=place, estimate=None)
    if len(observation) < settings.min_features:
        return replace(search, reason=perception.measurement.reason)
    views, said = _localized(search, perception, place, settings)
    if said.reason:
        trouble = '' if views.geometry else 'the robot has not moved yet, or sees no bearings: '
        search = replace(search, reason=trouble + said.reason)
    else:
        said = at_base(said, settings.camera_place)
        if at is not None and not agrees(said, at):
            count = search.contradictions + 1
            if count > MOST_CONTRADICTIONS:
                search = DockSearch(memory=memory, frame=frame)
            reason = 'views and driven path contradict each other'
            return replace(search, contradictions=count, reason=reason)
        said, at = filter_pose(said, before, motion)
        assert views.geometry is not None  # it was localized in it
        dock = dock_of(said, views.geometry, place.stamp_ns, settings)
        reason = _unpublished(dock, settings)
        search = replace(search, place=at, contradictions=0, estimate=dock, reason=reason)
    return replace(search, map=views.update_map(), mapped=place, goal=goal)


def _localized(
    search: DockSearch, perception: Perception, place: PathPlace, settings: DockPoseSettings
) -> tuple[KeyframeMap, MapLocalization]:
    """Return the servo's map after a view from ``place``, and the camera in it."""
    observation, measurement, memory = (
        perception.observation,
        perception.measurement,
        perception.memory,
    )
    assert observation is not None and observation.ids is not None  # tracks have both
    attitude = memory.mount_by(settings)
    views = search.map or KeyframeMap(attitude, settings.map)
    if views.mount.jitter < attitude.jitter:
        views = views.with_mount(attitude)
    mount, last = settings.camera_place, search.mapped or place
    ahead, left, _ = relative_pose(compose(last.pose, mount), compose(place.pose, mount))
    noise = np.maximum(memory.noise * observation.resolution, LEAST_NOISE)
    return views.after(
        FeatureObservations(observation.ids, observation.current, observation.desired, noise),
        np.array([-left, ahead]),
        bearings=measurement.rivals or tuple(filter(None, [measurement.bearings])),
        attitude=memory.attitude,
    )


def _motion(last: PathPlace, place: PathPlace) -> Motion:
    before, after = Pose(*last.pose.tolist()), Pose(*place.pose.tolist())
    return Motion(*motion_between(before, after), measured=True)


def at_base(said: MapLocalization, mount: FloatArray) -> MapLocalization:
    """Return the localization of the base, to which its camera is a ``mount``, (3,)."""
    camera, lever = camera_poses(said.pose[None])[0], inverse_pose(mount)
    base = compose(compose(mount, camera), lever)
    pose, slope = said.pose.copy(), np.eye(VIEW)
    pose[:PLACE] = -base[1], base[0], base[2]
    cosine, sine = math.cos(mount[2]), math.sin(mount[2])
    slope[:2, :2] = [[cosine, -sine], [sine, cosine]]
    swing = compose(np.array([0.0, 0.0, mount[2] + camera[2]]), lever)
    slope[:2, HEADING] = -swing[0], -swing[1]
    covariance, own = (slope @ each @ slope.T for each in (said.covariance, said.own))
    return replace(said, pose=pose, covariance=covariance, own=own, shift=slope @ said.shift)


def dock_of(
    said: MapLocalization, geometry: Geometry, stamp_ns: int, settings: DockPoseSettings
) -> DockPose:
    """Return the dock by a localization of the base, with what the mount is uncertain by."""
    right, ahead, heading = said.pose[:PLACE].tolist()
    yaw, variance = _yaw_error(geometry, settings.camera_yaw_deviation)
    covariance = said.covariance[:PLACE, :PLACE].copy()
    by_yaw = np.array([-ahead, right])
    lever = settings.camera_forward_deviation * 2.0 * math.sin(0.5 * heading)
    covariance[:2, :2] += variance * np.outer(by_yaw, by_yaw) + lever * lever * np.eye(2)
    place = np.array([right - yaw * ahead, ahead + yaw * right, heading])
    return DockPose(stamp_ns, *in_base(place, covariance))


def _yaw_error(geometry: Geometry, deviation: float) -> tuple[float, float]:
    """
    Return by how much the camera looks to the left of its configured yaw [rad], and the variance.

    A camera that looks aside of where it is driven has the driven places of its keyframes turned
    against those of the images. ``deviation`` is that of the configured yaw.
    """
    seen, driven = geometry.unknowns.views[:, :2], geometry.window.driven_places
    seen, driven = seen - seen.mean(0), driven - driven.mean(0)
    across, along = np.column_stack([-seen[:, 1], seen[:, 0]]), float((seen * driven).sum())
    if along <= 0.0:
        return 0.0, deviation**2
    turn = math.atan2(float((across * driven).sum()), along)
    slope = np.zeros((len(seen), VIEW))
    slope[:, :2] = across / along
    errors = slope.ravel() @ geometry.root[: slope.size]
    variance, prior = float(errors @ errors), deviation**2
    return turn * prior / (prior + variance), variance * prior / (prior + variance)


def _unpublished(dock: DockPose, settings: DockPoseSettings) -> str:
    """Return why the pose may not be published, or ''."""
    if dock.deviation > settings.publish_deviation:
        return f'its place is uncertain by {dock.deviation:.3f} m; drive on'
    if dock.heading_deviation > settings.publish_heading:
        return f'its heading is uncertain by {math.degrees(dock.heading_deviation):.1f} deg'
    return ''
