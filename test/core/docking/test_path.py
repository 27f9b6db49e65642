"""The driven path: where the base was at an image, how far off that is, when it begins anew."""

import math

import numpy as np
import pytest

from visual_servo_epipolar.core.docking.path import Path, PathPlace, uncertainty
from visual_servo_epipolar.core.geometry.motion import integrate, Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.geometry.planar_poses import compose, inverse_pose, relative_pose

S = 1_000_000_000


def test_motions_and_their_inverses_cancel() -> None:
    one, other = np.array([1.0, -2.0, 0.7]), np.array([-0.3, 0.4, 2.8])
    assert compose(one, inverse_pose(one)) == pytest.approx(np.zeros(3), abs=1e-12)
    assert compose(one, relative_pose(one, other)) == pytest.approx(other)


def test_between_two_messages_it_lies_between() -> None:
    path = Path()
    path.add_pose(0, Pose(0.0, 0.0, math.pi - 0.1))
    path.add_pose(S // 10, Pose(0.1, 0.0, -math.pi + 0.1))
    place = path.at(S // 20)
    assert place.pose[:2] == pytest.approx([0.05, 0.0])
    assert math.cos(place.pose[2]) == pytest.approx(-1.0)
    assert place.way == pytest.approx(0.05)
    assert place.turn == pytest.approx(0.1)


def test_beyond_its_ends_it_does_not_guess() -> None:
    path = Path()
    assert path.at(0) is None
    path.add_pose(S, Pose(0.0, 0.0, 0.0))
    assert path.at(S - 1) is None
    assert path.at(S + 1) is None
    assert path.at(S).stamp_ns == S


@pytest.mark.parametrize(
    ('stamp_ns', 'pose'),
    [
        (S, Pose(0.0, 0.0, 0.0)),
        (S // 2, Pose(0.0, 0.0, 0.0)),
        (3 * S, Pose(0.0, 0.0, 0.0)),
        (S + S // 10, Pose(2.0, 0.0, 0.0)),
        (S + S // 10, Pose(0.0, 0.0, 2.0)),
    ],
    ids=['repeated', 'back', 'gap', 'leap', 'spin'],
)
def test_odometry_that_cannot_be_begins_anew(stamp_ns, pose) -> None:
    path = Path()
    path.add_pose(S, Pose(0.0, 0.0, 0.0))
    path.add_pose(stamp_ns, pose)
    assert path.at(stamp_ns).epoch == 1


def test_commands_are_obeyed_until_the_next_one_or_the_timeout() -> None:
    path = Path(command_timeout=0.5)
    path.add_twist(0, Twist(1.0, 0.0))
    path.add_twist(S // 4, Twist(0.0, 1.0))
    assert path.at(S // 8).pose == pytest.approx([0.125, 0.0, 0.0])
    assert path.at(S // 2) is None
    assert path.at(S // 2, predict=True).pose == pytest.approx([0.25, 0.0, 0.25])
    assert path.at(5 * S, predict=True).pose == pytest.approx([0.25, 0.0, 0.5])
    path.add_twist(6 * S, STANDSTILL)
    assert path.at(7 * S, predict=True).pose == pytest.approx([0.25, 0.0, 0.5])


def test_odometry_goes_on_as_it_did_for_a_while() -> None:
    path, twist = Path(command_timeout=0.1), Twist(0.4, 0.5)
    for k in range(3):
        path.add_pose(k * S // 20, integrate(Pose(1.0, 2.0, 3.0), twist, k / 20))
    after = integrate(Pose(1.0, 2.0, 3.0), twist, 0.15)
    predicted = path.at(3 * S // 20, predict=True).pose
    assert predicted[:2] == pytest.approx([after.x, after.y])
    assert math.cos(predicted[2] - after.theta) == pytest.approx(1.0)
    assert path.at(3 * S // 20) is None


def test_what_it_did_before_a_leap_says_nothing_of_after() -> None:
    path = Path()
    for k in range(5):
        path.add_pose(k * S // 10, Pose(0.1 * k, 0.0, 0.0))
    path.add_pose(S // 2, Pose(50.0, 0.0, 0.0))
    assert path.at(S // 2 + S // 20, predict=True).pose == pytest.approx([50.0, 0.0, 0.0])


def test_old_places_are_forgotten() -> None:
    path = Path()
    for k in range(1000):
        path.add_pose(k * S // 20, Pose(0.0, 0.0, 0.0))
    assert path.at(0) is None
    assert len(path._places) < 100


def test_the_uncertainty_is_that_of_many_drives() -> None:
    deviation, steps, dt = 0.05, 60, 0.05
    twist, rng, ends = Twist(0.5, 0.0), np.random.default_rng(3), []
    for _ in range(1500):
        pose = Pose(0.0, 0.0, 0.0)
        for _ in range(steps):
            way = twist.linear * dt
            along, about = deviation * math.sqrt(way) * rng.standard_normal(2)
            pose = integrate(pose, Twist((way + along) / dt, about / dt), dt)
        ends.append([pose.x, pose.y, pose.theta])
    length = twist.linear * steps * dt
    before, after = (
        PathPlace(0, np.zeros(3)),
        PathPlace(1, np.array([length, 0.0, 0.0]), way=length),
    )
    drawn = np.cov(np.array(ends).T)
    assert uncertainty(before, after, deviation) == pytest.approx(drawn, rel=0.15, abs=2e-4)
