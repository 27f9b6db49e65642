"""Reports of the servo: phase, telemetry, diagnostics, markers; settings and events for bags."""

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.telemetry import progress, telemetry
from visual_servo_epipolar.messages import diagnostics, write
from visual_servo_epipolar.messages.diagnostics import Words
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.lifecycle.reports import NodeReports


class Reports(NodeReports):
    """Reports of the servo ``node``: all that it publishes but commands."""

    def __init__(self, node: Node, base_frame: str) -> None:
        super().__init__(node)
        self._base_frame = base_frame
        self._goal_pub = self._publisher(PoseWithCovarianceStamped, 'goal_pose', qos.STREAM)
        self._telemetry_pub = self._publisher(JointState, 'epipoles', qos.STREAM)
        self._phase_pub = self._publisher(String, 'phase', qos.LATCHED)
        self._progress_pub = self._publisher(JointState, '~/progress', qos.STREAM)
        self._result_pub = self._publisher(DiagnosticArray, '~/result', qos.LATCHED)
        self._markers_pub = self._publisher(MarkerArray, '~/markers', qos.STREAM)

    def phase(self, state: ServoState, words: Words) -> None:
        """Publish the phase, or that the servo is armed: it drives as soon as it can."""
        self._phase_pub.publish(write.text(words.phase(state)))

    def step(self, state: ServoState, image: tuple[int, str], words: Words) -> None:
        """Publish all that a step found out, with stamp and frame of its ``image``."""
        stamp_ns, frame_id = image
        self.phase(state, words)
        self._telemetry_pub.publish(write.telemetry(telemetry(state), stamp_ns, frame_id))
        estimate = state.measurement
        if estimate is not None and (goal := estimate.in_base()) is not None:
            self._goal_pub.publish(write.pose_with_covariance(goal, stamp_ns, self._base_frame))
        self._progress_pub.publish(write.telemetry(progress(state), stamp_ns, frame_id))
        self._diagnose(diagnostics.diagnosis(state, stamp_ns, name=self._name, words=words))
        self._markers_pub.publish(diagnostics.markers(state, stamp_ns, frame_id))

    def change(self, before: ServoState, state: ServoState, reason: str) -> None:
        """Publish what a change of the state makes of the run: running, and how it has ended."""
        word = diagnostics.outcome(before.phase, state.phase)
        if word:
            last = before if word == 'stopped' else state
            now_ns = self._clock.now().nanoseconds
            self._result_pub.publish(
                diagnostics.result(word, last, reason, now_ns, name=self._name)
            )

    def standing(self, state: ServoState, words: Words, *, alarming: bool) -> None:
        """Publish the phase and why the robot stands, where no image led to it."""
        self.phase(state, words)
        now_ns = self._clock.now().nanoseconds
        self._diagnose(
            diagnostics.standing_diagnosis(
                state, words, now_ns, name=self._name, alarming=alarming
            )
        )
