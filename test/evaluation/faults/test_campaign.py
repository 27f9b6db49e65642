"""The campaign of faults: when one strikes, what is refused."""

import numpy as np
import pytest

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.odometry.path import Path as DrivenPath
from visual_servo_epipolar.core.routes.run import RouteRun
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.evaluation.faults import campaign
from visual_servo_epipolar.evaluation.faults.campaign import FaultRun, FAULTS, plan, strike_time


def phases(fault: str, law: str, *, beside: bool = False) -> set[Phase]:
    rng, servo = np.random.default_rng(4), ServoSettings(law=law)
    times = [strike_time(FAULTS[fault], servo, rng, beside=beside) for _ in range(40)]
    return {time.phase for time in times}


@pytest.mark.parametrize('law', ['full', 'smooth'])
@pytest.mark.parametrize('beside', [False, True])
def test_a_fault_strikes_in_phases_that_the_law_has(law: str, beside: bool) -> None:
    rows = ServoSettings(law=law).machine.rows
    for fault in FAULTS:
        assert phases(fault, law, beside=beside) <= set(rows)


def test_a_law_of_one_motion_is_struck_on_its_way() -> None:
    driving = {phase.value for phase in phases('images_end', 'smooth') if phase.drives}
    assert driving == {'approaching'}


def test_a_law_that_there_is_not_is_refused_before_any_run() -> None:
    with pytest.raises(InputError, match='law must be one of'):
        plan(['none'], 1, 0, 'smoth')


def test_a_table_that_cannot_be_written_is_refused_first(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(campaign, 'drive', lambda *_: pytest.fail('runs were driven'))
    assert main(['faults', '--only', 'none', '--table', str(tmp_path)]) == 2
    assert 'cannot be written' in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.parametrize('checked', [True, False])
def test_a_route_taught_by_odometry_that_leaps_is_refused(checked: bool, monkeypatch) -> None:
    if not checked:
        monkeypatch.setattr(DrivenPath, '_rupture', lambda *_: '')
    result = campaign.one(FaultRun('teaching_odometry', 0))
    assert result['safe'] is checked
    said = '/odom leaps by 0.67 m' if checked else 'key views, written to'
    assert said in result['detail']


@pytest.mark.long
@pytest.mark.parametrize('reaches', [True, False])
def test_a_limit_lowered_in_mid_route_is_safe_if_it_is_taken(reaches: bool, monkeypatch) -> None:
    if not reaches:
        monkeypatch.setattr(RouteRun, 'use', lambda run, settings, servo: None)
    result = campaign.one(FaultRun('route_limits_lowered', 3))
    assert (result['safe'], result['struck_in']) == (reaches, 'approaching'), result['detail']
    assert reaches or result['verdict'] == 'limits exceeded'
