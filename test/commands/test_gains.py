"""``visual_servo gains``: what it prints is what the servo may be told."""

import json
import math

from command_line import document, refusal
import pytest
import yaml

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.laws.circumstances import Circumstances
from visual_servo_epipolar.core.laws.gains import (
    derive,
    longest_convergence,
    longest_matching,
)
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import updated

CASE = ['--farthest', '12', '--nearest', '2', '--rate', '11', '--latency', '0.09']
CIRCUMSTANCES = Circumstances(farthest=12.0, nearest=2.0, rate=11.0, latency=0.09)


def test_table_lines_to_paste_and_document_have_the_derived_gains(capsys, tmp_path) -> None:
    assert main(['gains', *CASE, '--json', str(tmp_path / 'gains.json')]) == 0
    output, gains = capsys.readouterr().out, derive(CIRCUMSTANCES)
    rows = {line[:11].strip(): line[11:].split() for line in output.splitlines()[:10]}
    assert rows['k1'][:2] == [f'{gains.k1:.4g}', '1/s']
    assert rows['k2'][0] == f'{gains.k2:.4g}'
    assert rows['beta/gamma'][0] == f'{gains.beta}/{gains.gamma}'
    assert rows['t_max'][:2] == [f'{gains.transient:.4g}', 's']
    assert rows['floor'][:2] == [f'{math.degrees(gains.floor):.4g}', 'deg']
    assert rows[''][0] == f'{longest_convergence(CIRCUMSTANCES, gains):.4g}'
    assert rows['step 2'][:2] == [f'{longest_matching(CIRCUMSTANCES, gains):.4g}', 's']
    values = pasted(output)
    settings = updated(ServoSettings(), values, 'pasted')
    assert settings.k2 == pytest.approx(gains.k2, rel=1e-5)
    assert settings.exponent == pytest.approx(gains.exponent, rel=1e-5)
    assert settings.initial_distance == 12.0
    assert list(values) == [name for name in ServoSettings.__dataclass_fields__ if name in values]
    result = json.loads((tmp_path / 'gains.json').read_text())
    assert (result['k1'], result['t_max_s']) == (gains.k1, gains.transient)
    assert result['floor_deg'] == math.degrees(gains.floor)
    assert result['circumstances']['latency'] == 0.09
    assert result['circumstances']['concordant'] is False


def pasted(output: str) -> dict:
    return yaml.safe_load(output.partition('\n\n')[2])['/**']['ros__parameters']


def test_a_gain_beyond_what_the_servo_takes_says_so(capsys: pytest.CaptureFixture) -> None:
    assert main(['gains', '--rate', '200', '--nearest', '8', '--deceleration', '20']) == 0
    output = capsys.readouterr().out
    assert 'k2: 5.0  # derived: 10.0' in output
    updated(ServoSettings(), pasted(output), 'pasted')


@pytest.mark.parametrize(
    ('options', 'phase', 'remedy'),
    [
        (
            ['--latency', '0.3'],
            'zeroing_epipoles may take 355 s',
            'raise phase_timeout to 360, or raise --nearest, or lower --latency',
        ),
        (
            ['--farthest', '90', '--nearest', '80'],
            'matching_features may take 229 s',
            'raise phase_timeout to 380, or raise --max-linear',
        ),
        (
            ['--latency', '2', '--max-linear', '0.05', '--max-angular', '0.1', '--farthest', '50'],
            'zeroing_epipoles may take 12325 s',
            'phase_timeout may be 3600 s at most: raise --nearest, or lower --latency',
        ),
    ],
)
def test_gains_that_are_too_slow_for_a_phase_are_a_warning(options, phase, remedy, capsys) -> None:
    assert main(['gains', *options]) == 0
    output = capsys.readouterr()
    assert output.err.startswith('visual_servo gains: warning: ')
    assert phase in output.err
    assert remedy in output.err
    values = pasted(output.out)
    assert main(['gains', *options, '--phase-timeout', str(values['phase_timeout'])]) == 0
    again = capsys.readouterr()
    assert (again.err == '') == ('at most' not in remedy), again.err
    assert f'phase_timeout: {values["phase_timeout"]}' in again.out
    updated(ServoSettings(), values, 'pasted')


def test_gains_that_are_quick_enough_are_no_warning(capsys: pytest.CaptureFixture) -> None:
    result, timeout = document(capsys, 'gains'), ServoSettings.phase_timeout
    assert (result['warnings'], result['phase_timeout_s']) == ([], timeout)


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        (['--phase-timeout', '0'], 'phase_timeout must lie in [1, 3600], got 0'),
        (['--concordant', '--current', '0.1'], 'concordant epipoles need |atan e_au| above'),
        (['--nearest', '9'], 'nearest must not exceed farthest, got 9 and 8 m'),
        (['--rate', '0'], 'rate must lie in [0.5, 1000], got 0; it is: Images a second [Hz]'),
    ],
)
def test_where_no_gain_is_legal_one_line_says_why(options, message, capsys) -> None:
    error = refusal(capsys, 'gains', *options)
    assert error.startswith(f'visual_servo gains: {message}')
