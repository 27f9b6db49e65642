"""Diagnostics and markers of the servo."""

from dataclasses import dataclass
import math

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point
from visualization_msgs.msg import Marker, MarkerArray

from visual_servo_epipolar.core.laws.phase import ARMED, Phase
from visual_servo_epipolar.core.laws.registry import phase_row, sentence
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.telemetry import telemetry
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.messages.read import BETWEEN

LEVELS = {Phase.HOLDING.value: DiagnosticStatus.WARN, Phase.FAILED.value: DiagnosticStatus.ERROR}


@dataclass(frozen=True, slots=True)
class Words:
    """
    Words of the node about a state, beside its own.

    ``reason``: why the robot stands, '' where the state says it; of one that is ``armed``, asked
    to start, when it begins to drive.
    """

    reason: str = ''
    armed: bool = False

    def phase(self, state: ServoState) -> str:
        """Return the phase in a word."""
        return ARMED if self.armed else state.phase.value

    def summary(self, state: ServoState) -> str:
        """Return in a sentence what the servo does, and why."""
        if self.armed:
            return f'{ARMED}, {self.reason}'
        return sentence(state.phase, self.reason or state.reason)


def diagnosis(
    state: ServoState, stamp_ns: int, *, name: str, words: Words = Words()
) -> DiagnosticArray:
    """Return phase, reason and telemetry as a diagnostic status."""
    values: dict[str, object] = {
        'phase': words.phase(state),
        'reason': state.reason,
        'warning': state.run.warning,
        'odometry': state.identified.odometry.refuted,
    }
    if state.measurement is not None:
        values['untrusted_because'] = state.measurement.reason
        values |= telemetry(state)
    notes = [state.identified.odometry.refuted]
    if state.measurement is not None and state.measurement.carried:
        notes.insert(0, f'{state.measurement.features} features in view, by the memory of views')
    return write.diagnostics(
        name,
        level=_level(state, alarming=any(notes)),
        summary='; '.join(filter(None, [words.summary(state), *notes])),
        values=values,
        stamp_ns=stamp_ns,
    )


def _level(state: ServoState, *, alarming: bool) -> bytes:
    level: bytes = LEVELS.get(state.phase.value, DiagnosticStatus.OK)
    return max(level, DiagnosticStatus.WARN) if alarming else level


def standing_diagnosis(
    state: ServoState, words: Words, stamp_ns: int, *, name: str, alarming: bool
) -> DiagnosticArray:
    """Return why the servo stands between two images, or still does, as a diagnostic status."""
    return write.diagnostics(
        name,
        level=_level(state, alarming=alarming),
        summary=words.summary(state),
        values={
            'phase': words.phase(state),
            'reason': words.reason or state.reason,
            'warning': state.run.warning,
            BETWEEN: True,
        },
        stamp_ns=stamp_ns,
    )


def markers(state: ServoState, stamp_ns: int, frame_id: str) -> MarkerArray:
    """Return the phase in its colour, and an arrow to the goal where its bearing is known."""
    words = _marker(0, Marker.TEXT_VIEW_FACING, stamp_ns, frame_id)
    words.text, words.scale.z, words.pose.position.y = state.phase.value, 0.2, -0.5
    row = phase_row(state.phase.value)
    if row is not None:
        red, green, blue = (part / 255.0 for part in bytes.fromhex(row.colour[1:]))
        words.color.r, words.color.g, words.color.b = red, green, blue
    arrow = _marker(1, Marker.ARROW, stamp_ns, frame_id)
    bearings = state.measurement.bearings if state.measurement is not None else None
    if bearings is None:
        arrow.action = Marker.DELETE
    else:
        end = Point(x=math.sin(bearings.current), y=0.0, z=math.cos(bearings.current))
        arrow.points = [Point(), end]  # a metre
        arrow.scale.x, arrow.scale.y = 0.03, 0.08
    return MarkerArray(markers=[words, arrow])


def _marker(number: int, kind: int, stamp_ns: int, frame_id: str) -> Marker:
    marker = Marker(header=write.header(stamp_ns, frame_id), ns='servo', id=number, type=kind)
    marker.pose.orientation.w = 1.0
    marker.color.g, marker.color.a = 1.0, 1.0
    return marker
