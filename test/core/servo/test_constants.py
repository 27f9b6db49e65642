"""Constants of the servo, each at its boundary: a factor more or less is another robot."""

from dataclasses import replace
import math

import pytest
from servo_states import asked, BEARINGS, in_phase, ranged, SETTINGS, sight

from visual_servo_epipolar.core.estimate.base_model import Curvature
from visual_servo_epipolar.core.estimate.extrinsics import (
    CORRELATION,
    moved,
    PSI,
    update_extrinsics,
)
from visual_servo_epipolar.core.geometry.epipolar import Bearings
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.core.laws.arrival import has_parallax
from visual_servo_epipolar.core.laws.phase import Phase


@pytest.mark.parametrize(
    ('features', 'deviations', 'changes', 'seen'),
    [
        # So many features that the root of their mean square varies by nothing.
        (10**8, 1.20, {}, False),
        (10**8, 1.30, {}, True),
        # Few vary more.
        (25, 0.97 * 1.3 * 1.25, {'memory': False}, False),
        (25, 1.03 * 1.3 * 1.25, {'memory': False}, True),
        (100, 0.97 * 1.15 * 1.25, {'memory': False}, False),
        (100, 1.03 * 1.15 * 1.25, {'memory': False}, True),
        # In doubt a robot allows for no such luck at first: a small way back and forth tells it.
        (25, 1.1 * 1.25, {}, True),
        (25, 1.1 * 1.25, {'attempts': 2}, False),
        (25, 1.1 * 1.25, {'focal_deviation': 1.0}, False),  # nothing is remembered through it
    ],
)
def test_noise_alone_shows_a_parallax_of_one_and_a_quarter(
    features, deviations, changes, seen
) -> None:
    still = sight(features=features, parallax=deviations * 0.3 / 769.0)
    state = in_phase(Phase.MATCHING_FEATURES, attempts=changes.get('attempts', 1))
    told = {name: value for name, value in changes.items() if name != 'attempts'}
    settings = replace(SETTINGS, arrival_parallax=0.0, **told)
    assert asked(has_parallax, state, still, settings) == seen


def learnt_turn(*, unrest: float, frames: int = 1) -> float:
    """Return the curvature after a straight metre that turned, ``frames`` after ``unrest``."""
    curvature = Curvature(change=unrest)
    for frame in range(frames):
        before = sight(frame, heading_error=0.0)
        after = sight(frame + 1, heading_error=0.002 if frame == frames - 1 else 0.0)
        travel = Twist(0.4 if frame == frames - 1 else 0.0, 0.0)
        curvature = curvature.updated(before, after, travel, 0.1, drift=0.01)
    return curvature.value


def test_a_command_that_changes_says_little_about_the_wheels() -> None:
    # It reaches them late by up to 0.2 s: a change of 0.2 rad/s is 0.04 rad of heading.
    calm, stirred = learnt_turn(unrest=0.0), learnt_turn(unrest=0.2)
    assert calm > 20.0 * stirred > 0.0
    # That unrest decays by half in a frame.
    halved = learnt_turn(unrest=0.1)
    assert learnt_turn(unrest=0.2, frames=2) == pytest.approx(halved, rel=0.05)


def test_the_unrest_of_a_change_counts_for_a_fifth_of_a_second() -> None:
    # gain = P s / (P s^2 + (0.2 change)^2): with s = 0.04 m, P = 0.0025, change = 0.5 rad/s.
    gain = 0.0025 * 0.04 / (0.0025 * 0.04**2 + 0.1**2 + 2.0 * 5e-4**2)
    off = Curvature().updated(
        sight(0, heading_error=0.0), sight(1, heading_error=0.15), Twist(0.4, 0.5), 0.1, drift=0.0
    )
    assert off.value == pytest.approx(gain * 0.1, rel=0.05)


@pytest.mark.parametrize(('count', 'contradicts'), [(12, False), (13, True)])
def test_more_than_twelve_contradictions_disprove_a_geometry(count, contradicts) -> None:
    assert ranged(contradictions=count).contradicts == contradicts


@pytest.mark.parametrize(('deviations', 'faults'), [(5.9, 0), (6.1, 5)])
def test_a_bearing_six_deviations_off_begins_the_path_anew(deviations: float, faults: int) -> None:
    before, deviation, heading = ranged(), 0.01, BEARINGS.heading_error
    there = moved(replace(before, travel=0.05), heading)
    variance = there.covariance[PSI, PSI] + CORRELATION * deviation**2
    psi = float(there.mean[PSI]) + deviations * math.sqrt(variance)
    odd = sight(bearings=Bearings(psi, psi - BEARINGS.psi + BEARINGS.phi), deviation=deviation)
    after = update_extrinsics(before, odd, 0.05, missed=False)
    assert after.contradictions == faults
