"""Reports of the servo: phase, telemetry, diagnostics, markers; settings and events for bags."""

from collections.abc import Sequence

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.telemetry import progress, telemetry
from visual_servo_epipolar.core.settings import Settings
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.messages import diagnostics, event_log, settings_text, write
from visual_servo_epipolar.messages.diagnostics import Words
from visual_servo_epipolar.messages.event_log import Entry
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.qos import report_publisher


class Reports:
    """Reports of the servo ``node``: all that it publishes but commands."""

    def __init__(self, node: Node) -> None:
        self._name, self._clock = node.get_fully_qualified_name(), node.get_clock()
        self._steady, self._diagnosed_ns = Clock(clock_type=ClockType.STEADY_TIME), 0
        self._telemetry_pub = report_publisher(node, JointState, 'epipoles', qos.STREAM)
        self._phase_pub = report_publisher(node, String, 'phase', qos.LATCHED)
        self._diagnostics_pub = report_publisher(
            node, DiagnosticArray, '/diagnostics', qos.DIAGNOSTICS
        )
        self._progress_pub = report_publisher(node, JointState, '~/progress', qos.STREAM)
        self._result_pub = report_publisher(node, DiagnosticArray, '~/result', qos.LATCHED)
        self._markers_pub = report_publisher(node, MarkerArray, '~/markers', qos.STREAM)
        self._settings_pub = report_publisher(node, String, '~/settings', qos.LATCHED)
        self._events_pub = report_publisher(node, String, '~/events', qos.DIAGNOSTICS)

    def phase(self, state: ServoState, words: Words) -> None:
        """Publish the phase, or that the servo is armed: it drives as soon as it can."""
        self._phase_pub.publish(write.text(words.phase(state)))

    def step(self, state: ServoState, image: tuple[int, str], words: Words) -> None:
        """Publish all that a step found out, with stamp and frame of its ``image``."""
        stamp_ns, frame_id = image
        self.phase(state, words)
        self._telemetry_pub.publish(write.telemetry(telemetry(state), stamp_ns, frame_id))
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

    @property
    def silence(self) -> float:
        """Time since the last diagnostics [s], on the steady clock."""
        return seconds_between(self._diagnosed_ns, self._steady.now().nanoseconds)

    def _diagnose(self, message: DiagnosticArray) -> None:
        self._diagnosed_ns = self._steady.now().nanoseconds
        self._diagnostics_pub.publish(message)

    def settings(self, groups: Sequence[Settings], after_stamp_ns: int | None) -> None:
        """Publish the settings in force, so that a bag can be replayed with them."""
        text = settings_text.to_text(self._name, groups, after_stamp_ns)
        self._settings_pub.publish(write.text(text))

    def event(self, name: str, after_stamp_ns: int | None, reason: str = '') -> None:
        """Publish what happened between two images, likewise."""
        entry = Entry(name, after_stamp_ns, reason)
        self._events_pub.publish(write.text(event_log.to_text(entry)))
