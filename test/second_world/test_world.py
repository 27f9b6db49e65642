"""A second simulator, of another renderer and other physics: robots arrive in it."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
import math
from typing import Any

import cv2
import numpy as np
import pytest
from second_world.scene import Painter

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import step
from visual_servo_epipolar.core.servo.telemetry import sample, telemetry
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.core.twoview.observation import observe
from visual_servo_epipolar.simulation.closed_loop import LoopSettings, RunMonitor, verdict
from visual_servo_epipolar.simulation.rigs import CameraMount, SimulatedRig

SEED, PERIOD_NS = 5, 100_000_000
CAMERA = Camera(640, 480, 550.0, 550.0, 324.0, 236.5, (-0.12, 0.03, 0.0006, -0.0004))
LEVEL, DOWN, UP = (
    CameraMount(0.35, 0.12, math.radians(tilt), math.radians(roll), 0.04, math.radians(yaw))
    for tilt, roll, yaw in ((0.0, 0.0, 0.0), (7.0, 2.0, 0.0), (-12.0, -5.0, 4.0))
)
RIGHT, LEFT = (0.8, -3.2, 6.0), (-1.0, -4.0, -8.0)  # x, y [m], heading error [deg]
# A robot of another make: two lagging wheels, a dead time, the right wheel larger than told.
STEP = 0.005  # of the integration [s]
TRACK = 0.42  # between the wheels [m]
LAG = 0.12  # time constant of a wheel [s]
DEAD_TIME = 0.09  # from a command to the motors [s]
RIGHT_WHEEL = 1.01  # of the radius that the motors believe in


@dataclass
class Robot:
    """Obeys commands as late and as crookedly as its motors do; Heun's method, step by step."""

    pose: Pose
    wheels: np.ndarray = field(default_factory=lambda: np.zeros(2))  # left and right [m/s]
    late: deque[Twist] = field(
        default_factory=lambda: deque([STANDSTILL] * round(DEAD_TIME / STEP))
    )

    def drive(self, command: Twist, seconds: float) -> None:
        for _ in range(round(seconds / STEP)):
            self.late.append(command)
            wanted = self.late.popleft()
            aside = 0.5 * TRACK * wanted.angular
            goal = np.array([wanted.linear - aside, wanted.linear + aside])
            self.wheels = self.wheels + STEP / LAG * (goal - self.wheels)
            self._move(float(self.wheels[0]), RIGHT_WHEEL * float(self.wheels[1]))

    def _move(self, left: float, right: float) -> None:
        pose, speed = self.pose, 0.5 * (left + right)
        turned = pose.theta + STEP * (right - left) / TRACK
        x = pose.x + 0.5 * STEP * speed * (math.cos(pose.theta) + math.cos(turned))
        y = pose.y + 0.5 * STEP * speed * (math.sin(pose.theta) + math.sin(turned))
        self.pose = Pose(x, y, turned)


@pytest.fixture(scope='module')
def painter() -> Iterator[Painter]:
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield Painter(CAMERA, SEED)
    cv2.setNumThreads(threads)


def driven(painter: Painter, mount: CameraMount, start: tuple[float, float, float]) -> Any:
    """Drive home from ``start``; return the verdict by ground truth."""

    def picture(pose: Pose, frame: int) -> Any:
        return painter.picture(mount.R_world_camera(pose), mount.centre(pose), frame)

    tracker, robot = Tracker(TrackerSettings()), Robot(Pose.from_start(*start))
    tracker.set_desired(picture(DESIRED_POSE, 0))
    state, settings, frame = ServoState(), ServoSettings(), 0
    loop = LoopSettings(start=start, frame_rate=10.0, max_duration=60.0, servo=settings)
    monitor = RunMonitor(loop)
    while not monitor.done:
        frame += 1
        features, stamp_ns = tracker.track(picture(robot.pose, frame)), frame * PERIOD_NS
        state = step(state, observe(features, CAMERA, stamp_ns), settings)
        taken = sample(stamp_ns, robot.pose, state.phase, telemetry(state))
        monitor.add(taken, reason=state.reason, attempts=state.run.attempts)
        robot.drive(state.command.twist, 1e-9 * PERIOD_NS)
    return verdict(monitor.log(), SimulatedRig(CAMERA, mount))


@pytest.mark.parametrize(
    ('mount', 'start'),
    [
        pytest.param(LEVEL, RIGHT, id='level, from the right', marks=pytest.mark.long),
        pytest.param(LEVEL, LEFT, id='level, from the left', marks=pytest.mark.long),
        pytest.param(DOWN, LEFT, id='7 deg down'),
        pytest.param(UP, RIGHT, id='12 deg up, 4 deg to the left', marks=pytest.mark.long),
    ],
)
def test_the_robot_arrives_and_never_drives_on_a_wrong_geometry(painter, mount, start) -> None:
    result = driven(painter, mount, start)
    assert result['wrong_geometry_s'] < 1.0
    assert result['max_distance_ratio'] <= 1.2
    assert result['outcome'] == 'arrived', result['reason']
    # Measured: 1.2 to 2.2 mm, 0.05 deg.
    assert result['position_error_m'] < 0.006
    assert abs(result['heading_error_deg']) < 0.2
