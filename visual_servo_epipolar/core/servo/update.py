"""Update of the state by a perception: what was driven, seen, identified, reckoned, settled."""

from visual_servo_epipolar.core.laws.decisions import row_of
from visual_servo_epipolar.core.laws.phases.conditions import has_turned, is_untrusted
from visual_servo_epipolar.core.perception.measurement import Measurement
from visual_servo_epipolar.core.perception.perceive import Perception
from visual_servo_epipolar.core.servo.dead_reckoning import (
    desired_rate,
    drive_since,
    reckon,
    usual_period,
)
from visual_servo_epipolar.core.servo.fusion.fuse import fuse, Fusion
from visual_servo_epipolar.core.servo.identify import identify
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.settling import settle
from visual_servo_epipolar.core.servo.state import ServoState, ViewState
from visual_servo_epipolar.core.values import changed


def update(
    state: ServoState, perception: Perception, dt: float, settings: ServoSettings
) -> ServoState:
    """
    Return the state updated by a ``perception`` ``dt`` [s] after the last, unclassified.

    ``settings`` have what was identified of the base: see ``Identification.effective``.
    """
    drive = drive_since(state, perception, dt, settings)
    fusion = fuse(state, perception, drive.increment, dt, settings)
    fusion, identified = identify(state, perception, fusion, drive, settings)
    measurement = fusion.measurement
    after = state.changed(
        view=_see(state, fusion, dt, settings),
        identified=identified,
        motion=reckon(state, measurement, identified, drive, settings),
        desired_rate=desired_rate(state, measurement, dt),
    )
    latched = row_of(after, settings).observe(after, measurement, settings)
    return settle(latched, perception, state.measurement, dt, settings)


def _see(state: ServoState, fusion: Fusion, dt: float, settings: ServoSettings) -> ViewState:
    """Return what is seen, with what perception and the map carry on."""
    return ViewState(
        measurement=fusion.measurement,
        memory=fusion.memory,
        goal=changed(state.view.goal, map=fusion.map),
        period=usual_period(state.view.period, dt),
        rotation_bias=fusion.rotation_bias,
        trusted_heading=_trusted_heading(state, fusion.measurement, settings),
        frame=state.view.frame,
    )


def _trusted_heading(
    state: ServoState, measurement: Measurement, settings: ServoSettings
) -> float:
    """Return the heading error of the last trusted image by which it drove [rad]."""
    if not state.phase.drives or is_untrusted(measurement, settings):
        return state.view.trusted_heading
    return (
        state.view.trusted_heading if has_turned(state, measurement) else measurement.heading_error
    )
