"""Blindness: whether the robot moved although nothing true had been seen for too long."""

from dataclasses import dataclass

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.evaluation.faults.judging.motion import braking_s, moving, speed
from visual_servo_epipolar.evaluation.faults.judging.record import Bounds, Record


@dataclass(frozen=True, slots=True)
class Blindness:
    """How long the robot moved without sight [s], and the charge if it was too long."""

    time_s: float
    charge: str


def blindness(record: Record, bounds: Bounds) -> Blindness:
    """
    Return the time that the robot moved without sight.

    The newest true sight grows old from when its image was taken: a late image is an old one.
    Beyond ``sight_s`` the robot must brake, and what it needs for that is no offence. A base whose
    process hung begins with that when it goes on.
    """
    if not record.truths:  # the base was gone before it had said where it is
        return Blindness(0.0, '')
    seen, newest_s, number = sorted(record.seen), record.truths[0].time_s, 0
    total_s, charge, at_onset, before_s = 0.0, '', STANDSTILL, newest_s
    for truth in record.truths:
        while number < len(seen) and seen[number].time_s <= truth.time_s:
            newest_s = max(newest_s, seen[number].taken_s)
            number += 1
        onset_s = newest_s + bounds.sight_s
        if truth.time_s >= record.woken_s:
            onset_s = max(onset_s, record.woken_s + bounds.period_s)
        if truth.time_s <= onset_s:
            at_onset = truth.twist
        elif moving(truth.twist):
            total_s += truth.time_s - before_s
            if truth.time_s > onset_s + braking_s(at_onset, bounds) and not charge:
                age_s = truth.time_s - newest_s
                charge = f'{speed(truth.twist)}, the last true sight {age_s:.1f} s old'
        before_s = truth.time_s
    return Blindness(total_s, charge)
