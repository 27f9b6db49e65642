"""The dock's pose in metres: the servo's estimate of its goal, at the scale of the driven path."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
import math
from typing import Any, ClassVar

import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.estimate.extrinsics import (
    corrected,
    driven_yaw,
    YAW,
)
from visual_servo_epipolar.core.estimate.goal_estimate import BaseModel, goal_estimate
from visual_servo_epipolar.core.geometry.least_squares import CONTRADICTING
from visual_servo_epipolar.core.geometry.motion import motion_between, Pose, relative_pose
from visual_servo_epipolar.core.goal import NO_GOAL
from visual_servo_epipolar.core.odometry.increments import Motion, OdometryIncrement
from visual_servo_epipolar.core.odometry.path import PathPlace
from visual_servo_epipolar.core.servo.estimator import fuse, of_the_axle, update_map
from visual_servo_epipolar.core.servo.run import change_goal
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.settings import fixed, internal, setting
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.core.twoview.perceive import perceive

MOST_CONTRADICTIONS = 8  # of views and driven path in a row: then all is begun anew


@dataclass(frozen=True, kw_only=True)
class DockPoseSettings(ServoSettings):
    """
    Settings of the servo that estimates the dock's pose, and when this is published.

    Angles in rad, lengths in m. The mount is known better than that of a servo, which finds it
    out while it drives.
    """

    INTERNAL: ClassVar[frozenset[str]] = frozenset(
        {item.name for item in fields(ServoSettings)}
        - {'camera_yaw', 'camera_forward', 'camera_left', 'path_deviation'}
    )
    GONE: ClassVar[Mapping[str, Any]] = {
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
    camera_yaw_deviation: float = internal(0.02, 'Deviation of that yaw [rad]', low=0.0, high=0.5)
    camera_forward_deviation: float = internal(
        0.02, 'Deviation of that offset ahead [m]', low=0.0, high=1.0
    )
    camera_left_deviation: float = internal(
        0.02, 'Deviation of that offset aside [m]', low=0.0, high=1.0
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


@dataclass(frozen=True, slots=True, eq=False)
class DockPose:
    """
    Pose of the dock in axes of the base at an image: x forward, y left [m], turn [rad], (3,).

    The dock is the base as it stood at the photograph. ``covariance``, (3, 3), is of all three.
    """

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

    def withheld(self, settings: DockPoseSettings) -> str:
        """Return why the pose may not be published, or ''."""
        if self.deviation > settings.publish_deviation:
            return f'its place is uncertain by {self.deviation:.3f} m; drive on'
        if self.heading_deviation > settings.publish_heading:
            return f'its heading is uncertain by {math.degrees(self.heading_deviation):.1f} deg'
        return ''

    def contradicts(self, other: 'DockPose') -> bool:
        """Return whether the ``other`` pose is farther away than chance explains."""
        off = self.pose - other.pose
        off[2] = math.remainder(off[2], 2.0 * math.pi)
        covariance = self.covariance + other.covariance
        return bool(off @ np.linalg.solve(covariance, off) > CONTRADICTING)


@dataclass(frozen=True, eq=False)
class DockSearch:
    """
    Search for the dock along the driven path; a new one begins from ``DockSearch()``.

    ``servo`` has the servo's map, and ``last`` is where the base was. ``expected`` is the dock by
    the last view that was believed, and what was driven since. ``estimate`` is that of this image;
    for a ``reason`` it is not to be published.
    """

    servo: ServoState = ServoState()
    last: PathPlace | None = None
    expected: DockPose | None = None
    contradictions: int = 0
    estimate: DockPose | None = None
    reason: str = 'nothing was seen yet'

    @property
    def dock(self) -> DockPose | None:
        """The pose that may be published, or None."""
        return None if self.reason else self.estimate

    @property
    def views(self) -> int:
        """The number of keyframes of the map."""
        return 0 if self.servo.map.views is None else len(self.servo.map.views.window)


def update_search(
    search: DockSearch,
    observation: Observation,
    place: PathPlace,
    settings: DockPoseSettings,
    *,
    goal: int = NO_GOAL,
) -> DockSearch:
    """Return the search after an ``observation`` of photograph ``goal`` from a ``place``."""
    if search.servo.goal.differs(goal) or (search.last and search.last.epoch != place.epoch):
        search = DockSearch()
    last = place.pose if search.last is None else search.last.pose
    driven = motion_between(Pose(*last.tolist()), Pose(*place.pose.tolist()))
    motion = Motion(*driven, measured=True)
    servo = change_goal(search.servo, goal)
    servo, estimate, reason = _estimated(servo, observation, motion, settings)
    expected = search.expected and _after(search.expected, relative_pose(last, place.pose), motion)
    search = replace(search, servo=servo, last=place, expected=expected)
    if estimate is None:
        return replace(search, estimate=None, reason=reason)
    if expected is not None and estimate.contradicts(expected):
        if search.contradictions == MOST_CONTRADICTIONS:
            search = DockSearch()
        reason, count = 'views and driven path contradict each other', search.contradictions + 1
        return replace(search, contradictions=count, estimate=None, reason=reason)
    reason = estimate.withheld(settings)
    return replace(search, expected=estimate, contradictions=0, estimate=estimate, reason=reason)


def _estimated(
    state: ServoState,
    observation: Observation,
    motion: Motion,
    settings: DockPoseSettings,
) -> tuple[ServoState, DockPose | None, str]:
    """Return the servo's state after an image, and where the dock is; None, and why, if unsure."""
    perception = perceive(observation, settings, state.view.frame, state.view.memory)
    increment = OdometryIncrement(motion, motion, trusted=True)
    fusion = fuse(state, perception, increment, 0.0, settings)
    reason = fusion.measurement.reason
    reason = reason or 'the robot has not moved yet, or sees no bearings'
    dock = None
    views = fusion.map.views
    if fusion.reading is not None and views is not None and views.geometry is not None:
        mounted = settings.extrinsics
        off, variance = driven_yaw(mounted, views.geometry)
        mounted = replace(corrected(mounted, YAW, off, variance), believed=True)
        measurement = of_the_axle(fusion.measurement, mounted)
        goal_pose = goal_estimate(measurement, fusion.reading, mounted, BaseModel()).in_base()
        dock = None if goal_pose is None else DockPose(*goal_pose)
    state = state.changed(
        goal=replace(state.goal, map=fusion.map), memory=fusion.memory, frame=state.view.frame + 1
    )
    return update_map(state), dock, reason


def _after(dock: DockPose, driven: FloatArray, motion: Motion) -> DockPose:
    """Return the ``dock`` from where a ``motion`` has ``driven``, (3,), as far as wheels grip."""
    share, way, turn = motion.noise, abs(motion.way), abs(motion.turn)
    walk = share.noise**2 * np.array([way, way + turn])
    doubt = walk + np.array([share.way * way, share.turn * turn]) ** 2
    pose = relative_pose(driven, dock.pose)
    slope = np.array([[-1.0, pose[1]], [0.0, -pose[0]], [0.0, -1.0]])
    return DockPose(pose, dock.covariance + slope * doubt @ slope.T)
