"""One run in memory: world, tracker and servo in one loop, without ROS and without a clock."""

from collections.abc import Callable
from dataclasses import replace

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.geometry.motion import (
    Pose,
    quaternion_from_yaw,
    yaw_from_quaternion,
)
from visual_servo_epipolar.core.servo.run import Run
from visual_servo_epipolar.core.servo.run_log import RunLog, Sample
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.telemetry import sample, telemetry
from visual_servo_epipolar.core.stamps import NANOSECONDS, period_ns
from visual_servo_epipolar.core.twoview.observation import Observation, observe
from visual_servo_epipolar.simulation.bases.registry import new_base, nod_of
from visual_servo_epipolar.simulation.mounts.pan_tilt import SimulatedHead
from visual_servo_epipolar.simulation.mounts.sensor import BodyState, PoseHistory
from visual_servo_epipolar.simulation.run_monitor import LoopSettings, RunMonitor
from visual_servo_epipolar.simulation.view import View

Control = Callable[[ServoState, Observation, ServoSettings], ServoState]

TICK_NS = 10**7  # between two places that are kept of a robot whose images come late


def published(pose: Pose) -> Pose:
    """Return ``pose`` as it arrives through a message, where the heading is a quaternion."""
    return Pose(pose.x, pose.y, yaw_from_quaternion(*quaternion_from_yaw(pose.theta)))


class Loop:
    """
    One closed loop, from the start until the servo ends.

    The order of events is that of the nodes in lockstep: ground truth, image, tracks, command, and
    only then does the base move for one period.
    """

    def __init__(self, settings: LoopSettings, view: View, camera: CameraModel) -> None:
        self.view, self.camera = view, camera
        self.monitor = RunMonitor(settings)
        self._servo = settings.servo
        start = Pose.from_start(*settings.start)
        self._base = new_base(settings.base, start, seed=settings.seed)
        self._head = None
        if settings.head is not None:
            self._head = SimulatedHead(settings.head, seed=settings.seed)
        self._run = Run(camera=camera, started=True)
        self._period_ns, self._receipt = period_ns(settings.frame_rate), settings.receipt
        self._history, self._exposed_ns = PoseHistory(), self._base.now_ns
        self.pose = published(self._base.pose)
        self._history.add(self._base.now_ns, self._body)
        self._advance()

    @property
    def frame(self) -> int:
        """Number of the frame that comes next: 0, 1, ..."""
        return len(self.monitor.samples)

    @property
    def now_ns(self) -> int:
        """Time of the next frame, by its stamp."""
        return self._base.now_ns if self._receipt.stamps else self._exposed_ns

    def run(
        self, *, watch: Callable[[Sample], None] | None = None, control: Control | None = None
    ) -> RunLog:
        """Drive until the servo ends, and return the record; arguments are those of ``run``."""
        while not self.monitor.done:
            self.decide(control)
            taken = self.record()
            if watch is not None:
                watch(taken)
            self.drive()
        return self.monitor.log()

    def decide(self, control: Control | None = None) -> None:
        """Look, and let the servo take it in, or another ``control``."""
        self._turn()
        features = self.view.observe(self.exposed_at, self.frame)
        seen = self._reckoned(observe(features, self.camera, self.now_ns))
        if control is not None:
            state = control(self._run.state, seen, self._servo)
            self._run = replace(self._run, state=state)
            return
        self._run = self._run.decide(seen, self._servo, goal=features.goal).update_map()

    @property
    def exposed_at(self) -> Pose:
        """Where the image was exposed that comes next: where the robot is, unless it is late."""
        return self._history.at(self._exposed_ns).pose

    @property
    def shown(self) -> Pose:
        """Where the robot was as the middle row of that image was read out: what it shows."""
        half_ns = round(0.5 * self._receipt.readout * NANOSECONDS)
        return self._history.at(self._exposed_ns + half_ns).pose

    @property
    def _body(self) -> BodyState:
        return BodyState(self.pose, self._base.twist, nod_of(self._base))

    def _turn(self) -> None:
        """Let the camera look where the head has turned it to, and move as the base does."""
        _, twist, nod = self._history.during(self._exposed_ns, self._receipt.readout)
        self.view.move(twist, nod)
        if self._head is not None:
            self.view.turn(self._head.joints)

    def _reckoned(self, observation: Observation) -> Observation:
        """Return ``observation`` with what wheels and joints say where base and head are."""
        joints, carrier = None if self._head is None else self._head.read(), self._servo.carrier
        if carrier.turn_rate > 0.0:
            observation = (
                observation.without_features()
                if joints is None
                else observation.on_rig(carrier, joints)
            )
        if not self._servo.odometry:
            return observation
        return replace(observation, odometry=published(self._base.odometry))

    def record(self) -> Sample:
        """Note the step that was decided."""
        state = self._run.state
        taken = sample(self.now_ns, self.pose, state.phase, telemetry(state))
        self.monitor.add(taken, reason=state.reason, attempts=state.run.attempts)
        return taken

    def drive(self) -> None:
        """Obey for one period."""
        self._base.command(self._run.state.command)
        if self._head is not None:
            self._head.command(self._run.state.command.head)
        self._advance()

    def _advance(self) -> None:
        """Move until the next image is received: at once the first one, if it is not late."""
        self._exposed_ns += self._period_ns if self.frame else 0
        end_ns, now_ns = self._exposed_ns + self._receipt.delay_ns(self.frame), self._base.now_ns
        if self.frame and self._receipt.stamps:  # one image after the other, however late it was
            end_ns = max(end_ns, now_ns + TICK_NS)
        tick_ns = TICK_NS if end_ns > self._exposed_ns else self._period_ns
        while now_ns < end_ns:
            now_ns = min(now_ns + tick_ns, end_ns)
            self._base.advance(now_ns)
            if self._head is not None:
                self._head.advance(now_ns)
            self.pose = published(self._base.pose)
            self._history.add(now_ns, self._body)


def run(
    settings: LoopSettings,
    view: View,
    camera: CameraModel,
    *,
    watch: Callable[[Sample], None] | None = None,
    control: Control | None = None,
) -> RunLog:
    """
    Drive from the start until the servo ends, and return the record.

    ``watch`` is called after each step; another law may stand in for the servo as ``control``.
    """
    return Loop(settings, view, camera).run(watch=watch, control=control)
