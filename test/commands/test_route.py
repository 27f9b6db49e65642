"""The command route: a way is learnt from a bag; the demo says what ground truth says."""

import json
from pathlib import Path

from bagmaker import write_bag
from command_line import refusal
import numpy as np
import pytest
from rclpy.serialization import serialize_message

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.messages.route_folder import read_route
from visual_servo_epipolar.simulation.choices import WAYS
from visual_servo_epipolar.simulation.routes import WAYS as CORNERS


def test_ways_have_one_set_of_names() -> None:
    assert tuple(CORNERS) == WAYS


@pytest.mark.parametrize(
    ('words', 'reason'),
    [
        ('demo --laps 1001', "'1001' is not a whole number from 1 to 1000"),
        ('demo --renewals 11', "'11' is not a whole number from 0 to 10"),
        ('teach /no/such/bag', 'visual_servo route: '),
    ],
)
def test_bad_input_is_one_line(words: str, reason: str, capsys) -> None:
    assert reason in refusal(capsys, 'route', *words.split())


@pytest.mark.parametrize(
    ('projection', 'code', 'reason'),
    [
        ('equirectangular', 1, 'an image shows too little'),
        ('pinhole', 2, 'projection must be one of'),
    ],
)
def test_a_projection_stands_for_a_camera_info(tmp_path, capsys, projection, code, reason) -> None:
    messages = []
    for level, stamp in enumerate((1, 10**9)):
        image = write.image(np.full((32, 64), level, np.uint8), 'mono8', stamp, 'c')
        command = write.twist(Twist(0.1, 0.0))
        for topic, message in (('/cmd_vel', command), ('/image_raw', image)):
            messages.append((topic, stamp, bytes(serialize_message(message))))
    bag = str(write_bag(tmp_path / 'bag', messages))
    assert main(['route', 'teach', bag, '--projection', projection]) == code
    assert reason in capsys.readouterr().err


@pytest.mark.long
def test_the_demo_repeats_what_it_taught(tmp_path: Path) -> None:
    result = tmp_path / 'result.json'
    words = ['--law', 'smooth', '--kidnaps', '5', '--out', str(tmp_path / 'out')]
    assert main(['route', 'demo', *words, '--json', str(result)]) == 0
    judged = json.loads(result.read_text())
    assert judged['outcome'] == 'arrived' and judged['lateral_rms_m'] < 4e-3
    assert judged['stations'][0]['position_error_m'] < 3e-3
    assert judged['kidnapped']['wrong'] == 0
    assert read_route(tmp_path / 'out/route').length == pytest.approx(judged['length_m'])
