"""The wheels: where odometry had the base at an image, and what is said where it had it not."""

import math
from types import SimpleNamespace
from typing import Any

from nav_msgs.msg import Odometry
import pytest
from servo_rig import PERIOD_NS, Rig

from visual_servo_epipolar.core.geometry.motion import integrate, Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.servo.telemetry import odometry_of
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.driving_inputs import AHEAD_S, DrivenPath
from visual_servo_epipolar.nodes.servo_node import MEANWHILE

S = 10**9
BEGIN, TWIST = Pose(4.0, -2.0, 3.1), Twist(0.4, 0.5)
RATE = 20  # [Hz]


class Stand(SimpleNamespace):
    """A node that remembers its subscription."""

    def __init__(self) -> None:
        super().__init__(profile=None, publishers=['wheels'])

    def resolve_topic_name(self, name: str) -> str:
        return f'/robot/{name}'

    def create_subscription(self, kind: type, topic: str, callback: Any, profile: Any) -> None:
        assert (kind, topic) == (Odometry, 'odom')
        self.profile, self.hear = profile, callback

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        assert topic == '/robot/odom'
        return [SimpleNamespace(node_namespace='/', node_name=it) for it in self.publishers]


class Bed:
    """Wheels that hear odometry, message by message, and are asked where they were."""

    def __init__(self, *, odometry: bool = True) -> None:
        self.node, self.said = Stand(), list[str]()
        self.driven = DrivenPath(self.node, self.said.append, listens=odometry, ahead=AHEAD_S)
        self.frame, self.number = 'odom', 0

    def hear(self, pose: Pose, stamp_ns: int, **orientation: float) -> None:
        message = write.odometry(pose, STANDSTILL, stamp_ns, self.frame, 'base_link')
        for name, value in orientation.items():
            setattr(message.pose.pose.orientation, name, value)
        self.node.hear(message)

    def drive(self, seconds: float) -> 'Bed':
        for _ in range(round(seconds * RATE)):
            self.hear(self.true(self.number / RATE), self.number * S // RATE)
            self.number += 1
        return self

    @staticmethod
    def true(seconds: float) -> Pose:
        return integrate(BEGIN, TWIST, seconds)

    def at(self, seconds: float) -> Pose | None:
        seen = Observation(round(seconds * S), *2 * [None], 700.0)
        return self.driven.with_odometry(seen).odometry


def off(pose: Pose | None, expected: Pose) -> float:
    assert pose is not None
    turn = math.remainder(pose.theta - expected.theta, 2.0 * math.pi)
    return math.hypot(pose.x - expected.x, pose.y - expected.y) + abs(turn)


def test_who_is_not_to_listen_does_not() -> None:
    bed = Bed(odometry=False)
    assert bed.node.profile is None
    assert bed.at(1.0) is None
    assert not bed.said


@pytest.mark.parametrize(
    ('lasted', 'seconds', 'words'),
    [
        (0.0, 1.0, 'nothing usable came on /robot/odom'),
        (1.0, 1.2, '/robot/odom is 0.25 s older than the image, stamped 0.95 s and 1.20 s; look'),
        (8.0, 1.0, '/robot/odom is 3.90 s newer than the image, stamped 4.90 s and 1.00 s; look'),
        (1.0, 1e9, 'stamped 0.95 s and 1000000000.00 s; let one clock stamp both'),
    ],
    ids=['silent', 'stale', 'too new', 'of another clock'],
)
def test_where_nobody_knows_there_is_none(lasted: float, seconds: float, words: str) -> None:
    bed = Bed().drive(lasted)
    assert bed.at(seconds) is None
    assert [text for text in bed.said if words in text]


def test_another_frame_is_a_leap_as_well() -> None:
    bed = Bed().drive(1.0)
    bed.frame, bed.node.publishers = 'map', ['wheels', 'ekf']
    bed.drive(0.1)
    words = '/robot/odom is in the frame map, was in odom before; look at what publishes it: /ekf'
    assert bed.said[0].startswith(words)
    assert bed.at(1.0) is None
    assert bed.at(1.05) is not None


def test_the_servo_hears_odometry_and_says_that_none_comes(bench) -> None:
    tell = bench.talk(Odometry, 'odom')
    rig = Rig(bench, odometry=True)
    rig.see()
    bench.until(lambda: bool(bench.logged('nothing usable came on /odom')), 'the complaint')
    assert bench.logged('nothing usable came on /odom')[0].endswith(MEANWHILE)
    assert odometry_of(rig.telemetry) is None
    for stamp_ns in (rig.stamp_ns - PERIOD_NS // 2, rig.stamp_ns + PERIOD_NS // 2):
        tell(write.odometry(BEGIN, STANDSTILL, stamp_ns, 'odom', 'base_link'))
    bench.settle()
    rig.see()
    assert off(odometry_of(rig.telemetry), BEGIN) < 1e-9


def test_a_servo_that_is_not_asked_for_it_subscribes_to_no_odometry(bench) -> None:
    rig = Rig(bench)
    assert 'odom' not in {item.topic_name.strip('/') for item in rig.node.subscriptions}
