"""Bases that do not follow slow commands, and nobody told: seen on the way, or not there."""

from typing import Any

from durations import few_of
import pytest
import untold_bases

from visual_servo_epipolar.core.estimate.dead_band import LEAST_ASKED, MARGIN
from visual_servo_epipolar.core.servo.state import ServoState

SEED = 303
RATE = 11.0  # images a second


def driven(
    name: str, base: dict[str, float], servo: dict[str, Any], rate: float = RATE
) -> tuple[dict[str, object], ServoState]:
    """Return what became of a run at ``rate`` images a second, and the last state of its servo."""
    return untold_bases.driven(name, SEED, base, servo, rate)


@pytest.mark.parametrize(
    ('name', 'zone', 'rate'),
    few_of(
        [
            ('nominal', 0.05, RATE),
            ('realistic', 0.01, 5.0),
            ('flat', 0.02, RATE),
            ('nominal', 0.01, RATE),
            ('realistic', 0.02, 30.0),
        ],
        keep=(1,),
    ),
)
def test_a_dead_band_that_nobody_told_is_found(name, zone, rate) -> None:
    untold = {'dead_band_linear': 0.0, 'dead_band_angular': 0.0}
    base = {'dead_zone_linear': zone, 'dead_zone_angular': zone}
    summary, state = driven(name, base, untold, rate)
    assert summary['outcome'] == 'arrived', summary['reason']
    assert float(str(summary['position_error_m'])) < 0.004
    learnt = state.identified.dead_band
    # Of a command below the zone, or what hops by 3 mm and 3 mrad.
    most = max(MARGIN * zone, 1.05 * LEAST_ASKED * rate)
    assert zone <= max(learnt.linear.value, learnt.angular.value) <= most


@pytest.mark.parametrize('law', ['full', 'smooth'])
def test_a_late_base_with_a_wide_dead_band_arrives_without_a_hold(law) -> None:
    base = {'dead_zone_linear': 0.03, 'dead_zone_angular': 0.08, 'command_delay': 0.2}
    servo = {'law': law, 'dead_band_linear': 0.0, 'dead_band_angular': 0.0}
    summary, state = driven('realistic', base, servo, 15.0)
    assert summary['outcome'] == 'arrived', summary['reason']
    assert 'holding' not in [phase['name'] for phase in summary['phases']]
    assert float(str(summary['position_error_m'])) < 0.005
    assert abs(float(str(summary['heading_error_deg']))) < 0.3
    assert float(str(summary['standing_s'])) < 12.0


@pytest.mark.parametrize(
    ('name', 'base'),
    few_of(
        [
            ('realistic', {}),
            ('nominal', {'command_delay': 0.3}),
            ('nominal', {}),
            ('flat', {}),
            ('nominal', {'slip': 0.15, 'wheel_ratio': 1.05}),
        ],
        keep=(1,),
    ),
)
def test_a_base_that_follows_teaches_none(name, base) -> None:
    summary, state = driven(name, base, {})
    assert summary['outcome'] == 'arrived', summary['reason']
    assert (
        state.identified.dead_band.linear.value == state.identified.dead_band.angular.value == 0.0
    )


@pytest.mark.parametrize(
    ('name', 'zone'), few_of([('realistic', 0.025), ('nominal', 0.04), ('flat', 0.04)])
)
def test_a_dead_band_that_is_told_does_not_keep_from_the_goals_heading(name, zone) -> None:
    base = {'dead_zone_linear': zone, 'dead_zone_angular': zone}
    told = {'dead_band_linear': 1.25 * zone, 'dead_band_angular': 1.25 * zone}
    summary, _ = driven(name, base, told)
    assert summary['outcome'] == 'arrived', summary['reason']
    # Equal pulses of 0.16 or 0.26 deg end anywhere within half of that.
    assert abs(float(str(summary['heading_error_deg']))) < 0.06
