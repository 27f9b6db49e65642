"""Bases with a dead band or a delay that is not configured: estimated, and driven."""

from dataclasses import replace
from typing import Any

from durations import few_of
import pytest
import untold_bases

from visual_servo_epipolar.commands.arguments import rig_path, scenario_path
from visual_servo_epipolar.core.estimate.base_model import largest_dead_band
from visual_servo_epipolar.core.estimate.dead_band import LEAST_ASKED, MARGIN
from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.supervisor import step
from visual_servo_epipolar.core.twoview.observation import Observation
from visual_servo_epipolar.simulation.regions import start_in
from visual_servo_epipolar.simulation.scenario import load
from visual_servo_epipolar.simulation.views import drive

SEED = 303
RATE = 11.0  # images a second


def driven(
    name: str, base: dict[str, float], servo: dict[str, Any], rate: float = RATE
) -> tuple[dict[str, Any], ServoState]:
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
def test_a_dead_band_that_is_not_configured_is_found(name, zone, rate) -> None:
    none = {'dead_band_linear': 0.0, 'dead_band_angular': 0.0}
    base = {'dead_zone_linear': zone, 'dead_zone_angular': zone}
    summary, state = driven(name, base, none, rate)
    assert summary['outcome'] == 'arrived', summary['reason']
    assert summary['position_error_m'] < 0.004
    learnt = state.identified.dead_band
    # Of a command below the zone, or what hops by 3 mm and 3 mrad.
    most = max(MARGIN * zone, 1.05 * LEAST_ASKED * rate)
    assert zone <= learnt.linear.value <= most
    assert learnt.angular.value <= largest_dead_band(
        ServoSettings().max_angular
    )  # assumed, where no turn has shown it


@pytest.mark.parametrize('law', ['full', 'smooth'])
def test_a_late_base_with_a_wide_dead_band_arrives_without_a_hold(law) -> None:
    base = {'dead_zone_linear': 0.03, 'dead_zone_angular': 0.08, 'command_delay': 0.2}
    servo = {'law': law, 'dead_band_linear': 0.0, 'dead_band_angular': 0.0}
    summary, state = driven('realistic', base, servo, 15.0)
    assert summary['outcome'] == 'arrived', summary['reason']
    assert 'holding' not in [phase['name'] for phase in summary['phases']]
    assert summary['position_error_m'] < 0.005
    assert abs(summary['heading_error_deg']) < 0.3
    assert summary['standing_s'] < 12.0


@pytest.mark.parametrize(
    ('name', 'base'),
    few_of(
        [
            ('realistic', {}),
            ('nominal', {'command_delay': 0.3}),
            ('nominal', {}),
            ('flat', {}),
            ('harsh', {}),
            ('nominal', {'slip': 0.15, 'wheel_ratio': 1.05}),
        ],
        keep=(1, 2),
    ),
)
def test_a_base_that_follows_teaches_neither_a_dead_band_nor_a_delay(name, base) -> None:
    summary, state = driven(name, base, {})
    assert summary['outcome'] == 'arrived', summary['reason']
    band = state.identified.dead_band
    assert band.linear.value == band.angular.value == 0.0
    assert state.identified.delay.value == 0.0 or 'command_delay' in base


@pytest.mark.parametrize('law', ['full', 'smooth'])
@pytest.mark.parametrize(
    ('rate', 'base', 'breathing'),
    few_of(
        [
            (15.0, {'nod': 0.0175, 'acceleration': 1.0}, 0.0),
            (6.0, {'nod': 0.0175, 'acceleration': 1.0}, 0.0),
            (30.0, {'nod': 0.01, 'acceleration': 1.5}, 0.0),
            (15.0, {}, 0.002),
            (15.0, {'dead_zone_linear': 0.03, 'dead_zone_angular': 0.06}, 0.002),
        ],
        keep=(0, 3),
    ),
)
def test_a_robot_ends_whose_body_nods_or_whose_lens_breathes(law, rate, base, breathing) -> None:
    stands, reversed_ways = [], []
    for seed in range(SEED, SEED + 3):
        summary, _ = untold_bases.driven(
            'nominal', seed, base, {'law': law}, rate, breathing=breathing
        )
        assert summary['outcome'] == 'arrived', summary['reason']
        assert summary['position_error_m'] < 0.006
        reversed_ways.append(summary['reversals']['v'])
        stands.append(summary['standing_s'])
    assert sorted(stands)[1] < 7.0 and sorted(reversed_ways)[1] <= 6


@pytest.mark.parametrize('seed', [2, 4])
def test_a_car_ends_whose_lens_breathes(seed) -> None:
    scenario = load(None, rig_path('car'))
    camera = replace(scenario.camera, breathing=0.002)
    scenario = replace(scenario, camera=camera).seeded(seed)
    summary = summarise(drive(scenario, start_in('front', SEED, seed, scenario), seed))
    assert summary['outcome'] == 'arrived', summary['reason']
    assert summary['position_error_m'] < 0.012
    assert summary['standing_s'] < 7.0


@pytest.mark.parametrize(
    ('name', 'zone'), few_of([('realistic', 0.025), ('nominal', 0.04), ('flat', 0.04)])
)
def test_a_configured_dead_band_does_not_keep_from_the_goals_heading(name, zone) -> None:
    base = {'dead_zone_linear': zone, 'dead_zone_angular': zone}
    configured = {'dead_band_linear': 1.25 * zone, 'dead_band_angular': 1.25 * zone}
    errors = []
    for seed in range(SEED, SEED + 5):
        summary, _ = untold_bases.driven(name, seed, base, configured, RATE)
        assert summary['outcome'] == 'arrived', summary['reason']
        errors.append(abs(summary['heading_error_deg']))
    # Equal pulses would end anywhere within half of 0.16 or 0.26 deg.
    assert sorted(errors)[2] < 0.03


SEED_LATE = 501
DEAF_IMAGES = 10  # 0.9 s


def obeys_late(
    name: str, delay: float, base: dict[str, float] | None = None, **servo: object
) -> tuple[dict[str, Any], ServoState]:
    """Return what became of a run whose base obeys late by ``delay`` [s], and the last state."""
    return untold_bases.driven(name, SEED_LATE, {'command_delay': delay, **(base or {})}, servo)


@pytest.mark.parametrize(
    ('name', 'delay'),
    few_of([('nominal', 1.0), ('realistic', 0.5), ('nominal', 0.5), ('harsh', 0.8)], keep=(1,)),
)
def test_a_base_that_obeys_late_arrives(name, delay) -> None:
    summary, state = obeys_late(name, delay)
    assert summary['outcome'] == 'arrived', summary['reason']
    assert summary['position_error_m'] < 0.0065
    assert state.identified.delay.value == pytest.approx(delay, abs=0.1)


def test_a_delay_that_is_configured_is_not_estimated() -> None:
    summary, state = obeys_late('nominal', 0.5, latency=0.55)
    assert summary['outcome'] == 'arrived', summary['reason']
    assert summary['position_error_m'] < 0.002
    assert state.identified.delay.value == 0.0


@pytest.mark.long
def test_without_anticipation_it_goes_round_and_round() -> None:
    summary, _ = obeys_late('nominal', 0.5, anticipation=False)
    assert summary['outcome'] == 'failed'


def test_a_dead_band_is_found_behind_a_delay() -> None:
    """Its pulses are shorter than the time between two images in which they act."""
    summary, state = obeys_late('nominal', 0.45, {'dead_zone_linear': 0.03})
    assert summary['outcome'] == 'arrived', summary['reason']
    assert state.identified.dead_band.linear.value >= 0.03


@pytest.mark.long
def test_gains_that_are_derived_know_that_laws_look_ahead() -> None:
    summary, _ = obeys_late('nominal', 0.5, gains='derived')
    assert summary['outcome'] == 'arrived', summary['reason']


def test_a_base_that_begins_late_once_is_driven_as_others_are() -> None:
    """Brakes that open late: what is learnt of it, if anything, is unlearnt."""
    scenario = load(scenario_path('nominal')).seeded(502)
    states: list[ServoState] = []

    def control(state: ServoState, seen: Observation, settings: ServoSettings) -> ServoState:
        states.append(step(state, seen, settings))
        turning = [it for it in states if it.twist.angular]
        if len(turning) <= DEAF_IMAGES:  # the base does not hear of it
            return states[-1].changed(command=Command(STANDSTILL))
        return states[-1]

    start = start_in('front', SEED_LATE, 2, scenario)
    summary = summarise(drive(scenario, start, 502, control=control))
    assert summary['outcome'] == 'arrived', summary['reason']
    assert summary['position_error_m'] < 0.003
    assert states[-1].identified.delay.value == 0.0
