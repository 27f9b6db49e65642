"""The wheels: where odometry had the base at an image, and what is logged where it had not."""

from nav_msgs.msg import Odometry
import pytest
from servo_rig import PERIOD_NS, Rig

from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL
from visual_servo_epipolar.core.servo.telemetry import odometry_of
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.servo_node import MEANWHILE

BEGIN = Pose(4.0, -2.0, 3.1)


def test_the_servo_hears_odometry_and_logs_that_none_comes(bench) -> None:
    tell = bench.talk(Odometry, 'odom')
    rig = Rig(bench, odometry=True)

    def driven(frame: str) -> Pose | None:
        """Publish odometry before and after the next image; return what the servo takes of it."""
        for stamp_ns in (rig.stamp_ns - PERIOD_NS // 2, rig.stamp_ns + PERIOD_NS // 2):
            tell(write.odometry(BEGIN, STANDSTILL, stamp_ns, frame, 'base_link'))
        bench.settle()
        rig.see()
        return odometry_of(rig.telemetry)

    rig.see()
    bench.until(lambda: bool(bench.logged('nothing usable came on /odom')), 'the complaint')
    assert bench.logged('nothing usable came on /odom')[0].endswith(MEANWHILE)
    assert odometry_of(rig.telemetry) is None
    pose = driven('odom')
    assert (pose.x, pose.y, pose.theta) == pytest.approx((BEGIN.x, BEGIN.y, BEGIN.theta))
    assert driven('map') is None  # two poses are not of one frame
    words = '/odom is in the frame map, was in odom before; look at what publishes it: /probe'
    bench.until(lambda: bool(bench.logged(words)), words)
    assert driven('map') is not None


def test_a_servo_that_is_not_asked_for_it_subscribes_to_no_odometry(bench) -> None:
    rig = Rig(bench)
    assert 'odom' not in {item.topic_name.strip('/') for item in rig.node.subscriptions}
