"""Diagnostics of the servo and of the tracker, and markers of the servo."""

import math

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point
from visualization_msgs.msg import Marker, MarkerArray

from visual_servo_epipolar.core.servo.phases.table import Phase
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.telemetry import telemetry
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.messages.read import BETWEEN

ARROW_M = 1.0
LEVELS = {Phase.HOLDING: DiagnosticStatus.WARN, Phase.FAILED: DiagnosticStatus.ERROR}


def diagnosis(state: ServoState, stamp_ns: int, *, name: str) -> DiagnosticArray:
    """Return phase, reason and telemetry as a diagnostic status."""
    values: dict[str, object] = {
        'phase': state.phase.value,
        'reason': state.reason,
        'warning': state.warning,
        'odometry': state.odometry.refuted,
    }
    if state.measurement is not None:
        values['untrusted_because'] = state.measurement.reason
        values |= telemetry(state)
    summary = f'{state.phase.value}: {state.reason}' if state.reason else state.phase.value
    level = LEVELS.get(state.phase, DiagnosticStatus.OK)
    if state.measurement is not None and state.measurement.carried:
        level = max(level, DiagnosticStatus.WARN)
        summary = f'{summary}; {carried_on(state.measurement.features)}'
    if state.odometry.refuted:
        level = max(level, DiagnosticStatus.WARN)
        summary = f'{summary}; {state.odometry.refuted}'
    return write.diagnostics(
        name,
        level=level,
        summary=summary,
        values=values,
        stamp_ns=stamp_ns,
    )


def carried_on(features: int) -> str:
    """Return in words that too few features are in view for two views, and what stands in."""
    return f'{features} features in view, by the memory of views'


def standing_diagnosis(
    state: ServoState, reason: str, stamp_ns: int, *, name: str, alarming: bool
) -> DiagnosticArray:
    """Return why the servo stands between two images, or still does, as a diagnostic status."""
    reason = reason or state.reason
    level = LEVELS.get(state.phase, DiagnosticStatus.OK)
    return write.diagnostics(
        name,
        level=max(level, DiagnosticStatus.WARN) if alarming else level,
        summary=f'{state.phase.value}: {reason}' if reason else state.phase.value,
        values={
            'phase': state.phase.value,
            'reason': reason,
            'warning': state.warning,
            BETWEEN: True,
        },
        stamp_ns=stamp_ns,
    )


def tracking_diagnosis(
    reason: str,
    features: int,
    stamp_ns: int,
    *,
    name: str,
    age_s: float | None = None,
    behind: str = '',
) -> DiagnosticArray:
    """
    Return the ``reason`` why the photograph is not found, '' if it is, as a status.

    With the age ``age_s`` [s] of the image whose tracks were published, where it is known, and in
    which words the tracker falls ``behind``, '' if it does not.
    """
    values: dict[str, object] = {'features': features, 'untracked_because': reason}
    if age_s is not None:
        values['image_age_s'] = round(age_s, 3)
    return write.diagnostics(
        name,
        level=DiagnosticStatus.WARN if reason or behind else DiagnosticStatus.OK,
        summary='; '.join(filter(None, (reason, behind))) or 'the photograph is found',
        values=values,
        stamp_ns=stamp_ns,
    )


def markers(state: ServoState, stamp_ns: int, frame_id: str) -> MarkerArray:
    """Return the phase in words, and an arrow towards the goal where its bearing is known."""
    words = _marker(0, Marker.TEXT_VIEW_FACING, stamp_ns, frame_id)
    words.text, words.scale.z, words.pose.position.y = state.phase.value, 0.2, -0.5
    arrow = _marker(1, Marker.ARROW, stamp_ns, frame_id)
    bearings = state.measurement.bearings if state.measurement is not None else None
    if bearings is None:
        arrow.action = Marker.DELETE
    else:
        right, ahead = math.sin(bearings.current), math.cos(bearings.current)
        arrow.points = [Point(), Point(x=ARROW_M * right, y=0.0, z=ARROW_M * ahead)]
        arrow.scale.x, arrow.scale.y = 0.03, 0.08
    return MarkerArray(markers=[words, arrow])


def _marker(number: int, kind: int, stamp_ns: int, frame_id: str) -> Marker:
    marker = Marker(header=write.header(stamp_ns, frame_id), ns='servo', id=number, type=kind)
    marker.pose.orientation.w = 1.0
    marker.color.g, marker.color.a = 1.0, 1.0
    return marker
