"""Following: which views are believed, and what is driven without one."""

from dataclasses import replace
import math

import numpy as np
import pytest
from routes import key_view, route_of

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.bases.limiter import Limiter
from visual_servo_epipolar.core.bases.registry import base_of
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.routes.follower import (
    beside,
    brake,
    Follower,
    PathEstimate,
    PathMeasurement,
    steer,
)
from visual_servo_epipolar.core.routes.key_view_tracker import KeyViewTracker
from visual_servo_epipolar.core.routes.path import PathPoint, TaughtPath
from visual_servo_epipolar.core.routes.route import RouteView
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.routes.structure import ViewPose
from visual_servo_epipolar.core.servo.settings import ServoSettings

SETTINGS = FollowSettings()
LIMITS = replace(ServoSettings().drive.limits, max_linear=0.5, max_angular=1.0)
BASE = base_of(ServoSettings().base, LIMITS)
WAY, EXACT = np.linspace(0.0, 2.0, 21), np.full(3, 1e-3)


def straight(heading: float) -> TaughtPath:
    """Return a straight path in a direction, as the camera of a key view sees it."""
    poses = np.stack([WAY * math.cos(heading), WAY * math.sin(heading), np.full(21, heading)], 1)
    return TaughtPath(WAY, poses, np.zeros(21), np.full(21, 0.5))


def seen(heading: float, offset: float, turn: float, along: FloatArray) -> ViewPose:
    """Return a place beside the middle of the path; ``along`` deviations are in its axes."""
    left = np.array([-math.sin(heading), math.cos(heading)])
    ahead = np.array([math.cos(heading), math.sin(heading)])
    axes = np.eye(3)
    axes[:2, 0], axes[:2, 1] = ahead, left
    covariance = axes @ np.diag(along**2) @ axes.T
    return ViewPose(np.append(ahead + offset * left, heading + turn), covariance, 40, 0.01)


def sure(way: float = 1.0, variance: float = 0.0) -> PathEstimate:
    """Return an estimate on the path, to a tenth of a millimetre beside it."""
    estimate = PathEstimate(way, 0.1)
    estimate.is_placed, estimate.covariance = True, np.diag([1e-8, 1e-8, 1e-8])
    estimate.way_variance = variance
    return estimate


def is_believed(measured: PathMeasurement, slip: float = 0.0, variance: float = 0.0) -> bool:
    """Whether a view is believed where what was predicted is known to a tenth of a millimetre."""
    return not sure(1.0 - slip, variance).trouble(measured)


@pytest.mark.parametrize('heading', [0.0, 0.5 * math.pi, 2.0])
def test_the_gate_goes_by_the_deviations_across_the_path_and_of_the_turn(heading: float) -> None:
    path = straight(heading)
    # Uncertain along the way alone: that widens the gate of neither offset nor turn.
    along = np.array([0.5, 1e-3, 1e-3])
    assert is_believed(beside(path, seen(heading, 0.0, 0.0, along), 1.0), slip=0.5)
    assert not is_believed(beside(path, seen(heading, 0.03, 0.0, along), 1.0))
    assert not is_believed(beside(path, seen(heading, 0.0, 0.03, along), 1.0))
    # Uncertain across the way, or in its turn: that widens its own gate alone.
    across, turning = np.array([1e-3, 0.1, 1e-3]), np.array([1e-3, 1e-3, 0.1])
    assert is_believed(beside(path, seen(heading, 0.03, 0.0, across), 1.0))
    assert not is_believed(beside(path, seen(heading, 0.0, 0.03, across), 1.0))
    assert not is_believed(beside(path, seen(heading, 0.0, 0.0, across), 1.0), slip=0.03)
    assert is_believed(beside(path, seen(heading, 0.0, 0.03, turning), 1.0))
    assert not is_believed(beside(path, seen(heading, 0.03, 0.0, turning), 1.0))
    # Long without a view, the base may have slipped.
    exact = beside(path, seen(heading, 0.0, 0.0, EXACT), 1.0)
    assert is_believed(exact, slip=0.03, variance=0.01**2)


def test_a_rejected_view_is_reported_in_metres_and_radians() -> None:
    measured = beside(straight(0.0), seen(0.0, -0.25, 0.125, EXACT), 1.0)
    reason = sure(0.5).trouble(measured)
    assert '+0.500 m along the way, -0.250 m beside it and +0.125 rad off' in reason


def follower_on(path: TaughtPath, view: RouteView) -> Follower:
    """Return a follower 1 m along a path, at full speed, that believes views to a millimetre."""
    views = (replace(view, path=path), replace(key_view(1), path=path, way=2.0))
    follower = Follower(route_of(*views), SETTINGS, BASE, view=1, target=1, way=1.0, latency=0.1)
    follower.estimate = sure()
    follower.limiter = Limiter(Twist(0.5, 0.5 * path.curvature_at(1.0)))
    return follower


@pytest.mark.parametrize(
    ('ahead', 'is_believed'), [(0.04, True), (0.14, False), (-0.08, True), (-0.24, False)]
)
def test_a_place_beyond_what_it_drives_is_not_believed(ahead, is_believed, monkeypatch) -> None:
    """As by a cabinet that was moved along the wall; the base may have stood, though."""
    follower = follower_on(straight(0.0), key_view(0))
    follower.halt(0, unsent=False)
    follower.estimate.sent(0, Twist(0.5, 0.0))
    follower.stamp_ns = 100_000_000
    place = seen(0.0, 0.0, 0.0, EXACT)._replace(pose=np.array([1.1 + ahead, 0.0, 0.0]))
    monkeypatch.setattr(KeyViewTracker, 'locate', lambda *_: place)
    progress = follower.step(follower.route.views[0].image, 300_000_000)
    assert bool(progress.inliers) is is_believed, follower.reason
    assert progress.way == pytest.approx(1.1 + ahead * is_believed)


def test_after_a_hold_the_robot_speeds_up_by_its_ramps(monkeypatch: pytest.MonkeyPatch) -> None:
    follower = follower_on(straight(0.0), key_view(0))
    place = seen(0.0, 0.0, 0.0, EXACT)
    follower.stamp_ns = 0
    follower.halt(0, unsent=False)
    monkeypatch.setattr(KeyViewTracker, 'locate', lambda *_: place)
    follower.step(follower.route.views[0].image, 3 * 10**9)
    assert follower.twist.linear == pytest.approx(0.15 * LIMITS.max_acceleration)


def test_without_a_view_the_robot_slows_down_on_the_same_curve() -> None:
    arc = replace(straight(0.0), curvatures=np.full(21, 0.9))
    follower = follower_on(arc, key_view(0))
    twists = [follower.twist]
    for follower.lost in (0.09, 0.18, 0.27, 0.36, 0.45):
        follower.limiter = Limiter(follower._wanted(None, 0.09))
        twists.append(follower.twist)
    speeds, turns = np.array([[twist.linear, twist.angular] for twist in twists]).T
    assert speeds[-1] < 0.3
    assert turns / speeds == pytest.approx(np.full(6, 0.9), abs=0.02)
    assert np.abs(np.diff(turns)).max() < 0.05 * SETTINGS.max_turn_rate


DT = 1.0 / 11.0


def driven(
    speed: float, offset: float, *, wheels: float = 0.0, curvature: float = 0.0
) -> list[float]:
    """Return the true offsets [m] on five metres of a path, seen with a millimetre of noise."""
    rng, it = np.random.default_rng(2), PathEstimate(0.0, 0.0)
    turn, offsets = 0.0, []
    for _ in range(round(5.0 / (abs(speed) * DT))):
        noise = [1e-3, 3e-4] * rng.standard_normal(2)
        see(it, offset + noise[0], turn + noise[1], curvature)
        twist = steer(it.state, curvature, speed, SETTINGS)
        rate = twist.angular + twist.linear * (wheels - curvature)
        offset += twist.linear * math.sin(turn + 0.5 * rate * DT) * DT
        turn += rate * DT
        it.move(twist, DT)
        offsets.append(offset)
    return offsets


def see(it: PathEstimate, offset: float, turn: float = 0.0, curvature: float = 0.0) -> None:
    """Let an estimate take in a view, known to a millimetre."""
    point = PathPoint(it.way, offset, turn, curvature, 0.5)
    it.update(PathMeasurement(point, np.diag([1e-6, 1e-6, 1e-7]), 40))


@pytest.mark.parametrize('speed', [0.5, 0.2, -0.3])
def test_an_offset_fades_without_passing_the_path_far(speed: float) -> None:
    offsets = driven(speed, 0.1)
    assert abs(np.array(offsets)[-20:]).max() < 5e-3
    assert min(offsets) > -0.01


def test_an_arc_is_followed_and_what_unequal_wheels_add_is_learnt() -> None:
    assert abs(np.array(driven(0.5, 0.0, curvature=0.9))[-30:]).max() < 4e-3
    assert abs(np.mean(driven(0.5, 0.0, wheels=0.03)[-30:])) < 2e-3  # 7.5 mm where it is not


def test_a_step_between_key_views_turns_the_robot_by_little() -> None:
    it, turns = PathEstimate(0.0, 0.0), []
    for offset in [*[0.0] * 40, 2e-3]:
        it.move(Twist(0.5, 0.0), DT)
        see(it, offset)
        turns.append(steer(it.state, 0.0, 0.5, SETTINGS).angular)
    assert abs(turns[-1] - turns[-2]) < 0.05 * SETTINGS.max_turn_rate


def test_it_can_stop_where_the_way_ends() -> None:
    assert brake(0.0, 0.3) <= 0.05
    assert brake(0.5, 0.3) ** 2 / (2.0 * 0.3) <= 0.5
