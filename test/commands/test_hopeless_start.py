"""A start from which nothing of the photograph is in view ends soon, wherever it is simulated."""

import json
from pathlib import Path

import pytest

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.servo.settings import ServoSettings

AWAY = ('--start', '0', '-3', '180', '--scenario')
TINY = """
camera: {width: 320, height: 240, focal_length: 192.0, principal_u: 159.5, principal_v: 119.5}
"""
REASON = 'no feature of the photograph is in view'


def failed(path: Path) -> None:
    result = json.loads(path.read_text(encoding='utf-8'))
    assert result['outcome'] == 'failed'
    assert result['reason'].startswith(REASON)
    assert 0.0 <= result['duration_s'] - ServoSettings.holding_timeout < 0.2
    assert [phase['name'] for phase in result['phases']] == ['waiting']


@pytest.mark.parametrize('source', ['features', pytest.param('images', marks=pytest.mark.long)])
def test_a_simulation_ends_with_the_reason(tmp_path: Path, source: str) -> None:
    path = tmp_path / 'result.json'
    assert main(['simulate', *AWAY, 'small', '--source', source, '--json', str(path)]) == 1
    failed(path)


def test_the_demo_ends_with_the_reason_and_leaves_nothing_of_before(tmp_path: Path) -> None:
    pytest.importorskip('rclpy')
    pytest.importorskip('matplotlib')
    (tmp_path / 'video.mp4').write_bytes(b'that of an earlier run')
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag/bag_0.mcap').touch()
    scenario = tmp_path / 'tiny.yaml'
    scenario.write_text(TINY)
    options = ('--no-video', '--bag', 'none', '--out', str(tmp_path))
    assert main(['demo', *AWAY, str(scenario), *options]) == 1
    failed(tmp_path / 'result.json')
    assert not (tmp_path / 'video.mp4').exists()
    assert not (tmp_path / 'bag').exists()
