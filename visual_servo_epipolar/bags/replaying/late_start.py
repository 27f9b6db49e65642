"""Late start: a recording that began while tracker or servo were at work already."""

from visual_servo_epipolar.bags.reading.run import in_force, Key, Recording
from visual_servo_epipolar.core.servo.phases.table import Phase, TRANSITIONS

FIRST_PHASES = {Phase.WAITING.value} | {
    phase.value for (before, _), phase in TRANSITIONS.items() if before is Phase.WAITING
}
TRACKER = (
    'the recording began after the tracker: what it had seen before is unknown, so that replayed '
    'images may give other tracks; --tracks replays those that were recorded'
)
SERVO = (
    'the recording began after the servo had started: its state is unknown, so that the replay '
    'begins anew and its commands differ; start the recorder before the servo'
)


def late_start_notes(run: Recording, *, from_tracks: bool) -> list[str]:
    """Return notes on what was at work before the recording began."""
    notes = []
    if run.first_age and not from_tracks:
        notes.append(TRACKER)
    if run.telemetry and _is_servo_at_work(run, min(run.telemetry)):
        notes.append(SERVO)
    return notes


def _is_servo_at_work(run: Recording, first: Key) -> bool:
    """Return whether the servo is beyond its first step: by its phase, or by d_hat."""
    phase = run.diagnoses.get(first[0], {}).get('phase', Phase.WAITING.value)
    if phase not in FIRST_PHASES:
        return True
    recorded = in_force(run.servo, first[0])
    values = {} if recorded is None else recorded.values
    initial, least = values.get('initial_distance'), values.get('min_distance')
    if not (isinstance(initial, float) and isinstance(least, float)):
        return False
    first_estimate = max(initial, least)
    return run.telemetry[first].get('distance_estimate_m', first_estimate) != first_estimate
