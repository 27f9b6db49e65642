"""The verdict on a run: for how long the robot drove on a geometry that was wrong."""

from dataclasses import replace
import math
from typing import Any

import pytest

from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.servo.run_log import RunLog, Sample, summarise
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.closed_loop import verdict, wrong_geometry_s

POSE = Pose.from_start(0.5, -2.0, 5.0)
TRUE = Bearings.from_pose(POSE)
LEVEL = CameraSettings().rig()
DRIVING = Twist(0.1, 0.0)


def log_of(*samples: Sample) -> RunLog:
    """Return a run with a sample each half second."""
    timed = [replace(it, stamp_ns=k * NANOSECONDS // 2) for k, it in enumerate(samples)]
    return RunLog((0.5, -2.0, 5.0), 0, timed, 'failed', 'none')


def driven(**changes: Any) -> Sample:
    """Return a sample of a robot that drives on the true geometry, but for ``changes``."""
    true = {'bearing_current': TRUE.current, 'bearing_desired': TRUE.desired}
    return Sample(**{'stamp_ns': 0, 'pose': POSE, 'twist': DRIVING, **true, **changes})


WRONG = driven(bearing_current=TRUE.current + math.radians(11.0))


@pytest.mark.parametrize(
    ('sample', 'seconds'),
    [
        (driven(), 0.0),
        (WRONG, 0.5),
        (driven(bearing_desired=TRUE.desired - math.radians(11.0)), 0.5),
        (driven(bearing_current=TRUE.current + math.radians(9.0)), 0.0),
        (replace(WRONG, twist=Twist(0.0, -0.1)), 0.5),
        (replace(WRONG, twist=STANDSTILL), 0.0),
        (replace(WRONG, bearing_desired=math.nan), 0.0),
        (driven(pose=Pose.from_start(0.0, -0.019, 0.0), bearing_current=1.0), 0.0),
        (driven(pose=Pose.from_start(0.0, -0.021, 0.0), bearing_current=1.0), 0.5),
    ],
)
def test_time_counts_while_driving_on_bearings_more_than_ten_degrees_off(sample, seconds) -> None:
    assert wrong_geometry_s(log_of(sample, driven()), LEVEL) == seconds


def test_times_add_up_and_the_last_sample_lasts_no_time() -> None:
    assert wrong_geometry_s(log_of(WRONG, driven(), WRONG, WRONG), LEVEL) == 1.0


def test_what_a_level_camera_sees_right_is_wrong_for_a_yawed_one() -> None:
    yawed = CameraSettings(mount_yaw=math.radians(11.0)).rig()
    assert wrong_geometry_s(log_of(driven(), driven()), yawed) == 0.5


def test_the_verdict_is_the_summary_and_one_key_more() -> None:
    log = log_of(WRONG, driven())
    assert verdict(log, LEVEL) == {**summarise(log), 'wrong_geometry_s': 0.5}
