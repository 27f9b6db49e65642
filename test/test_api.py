"""The public Python face: its names do what the commands do, and importing it stays cheap."""

import json
from pathlib import Path
import subprocess
import sys

from bagmaker import write_bag
from inspected import kept, SMALL
import pytest

from visual_servo_epipolar import api
from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import CameraSettings

START = (0.5, -3.0, 5.0)


def test_every_public_name_is_there_and_documented() -> None:
    assert len(api.__all__) <= 13
    assert [name for name in api.__all__ if not getattr(api, name).__doc__] == []


def test_the_package_loads_nothing_and_the_face_no_ros_and_no_figures() -> None:
    code = (
        'import sys, visual_servo_epipolar\n'
        "print([name for name in ('numpy', 'cv2') if name in sys.modules])\n"
        'import visual_servo_epipolar.api\n'
        "print([name for name in ('rclpy', 'rosbags', 'matplotlib') if name in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout == '[]\n[]\n'


def test_a_run_and_a_sweep_are_those_of_the_commands(tmp_path: Path, capsys) -> None:
    log = api.simulate(START, law='smooth', seed=3, scenario=api.load_scenario('realistic'))
    words = ['--law', 'smooth', '--seed', '3', '--scenario', 'realistic', '--json', '-']
    assert main(['simulate', '--start', *map(str, START), *words]) == 0
    result = json.loads(capsys.readouterr().out)
    assert json.loads(json.dumps(api.summarise(log))).items() <= result.items()
    document = api.sweep('front', 2, tmp_path / 'sweep', laws=['smooth'])['smooth']
    assert [run['outcome'] for run in document['runs']] == ['arrived', 'arrived']


def test_a_bag_is_replayed_with_other_settings(small_run, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / 'run', small_run)
    recorded, slower = api.replay(bag), api.replay(str(bag), servo={'max_linear': 0.1})
    assert recorded.samples[0].stamp_ns == slower.samples[0].stamp_ns
    fastest = [max(abs(item.twist.linear) for item in log.samples) for log in (recorded, slower)]
    assert fastest[0] > 0.15
    assert fastest[1] == pytest.approx(0.1)


def test_photographs_are_inspected_from_files(tmp_path: Path) -> None:
    world = CameraSimulator(CameraSettings(**SMALL))
    now = world.capture(Pose.from_start(*START), 0)
    kept(tmp_path, {'goal': world.photograph(), 'now': now})
    found = api.inspect(*(tmp_path / name for name in ('goal.png', 'now.png', 'camera.yaml')))
    assert found.trusted, found.reason


def test_a_folder_without_a_route_is_refused(tmp_path: Path) -> None:
    with pytest.raises(api.InputError, match='no folder of a route'):
        api.load_route(tmp_path)


@pytest.mark.parametrize(
    ('changes', 'words'),
    [
        ({'region': 'nowhere'}, 'region must be one of front, beside'),
        ({'source': 'video'}, "source must be one of features, images, got 'video'"),
        ({'runs': 0}, 'a sweep needs a run and a law, got 0 runs of 1 laws'),
        ({'laws': ()}, 'a sweep needs a run and a law, got 1 runs of 0 laws'),
    ],
)
def test_a_sweep_that_cannot_be_is_refused_before_it_writes(tmp_path, changes, words) -> None:
    asked = {'region': 'front', 'runs': 1, 'folder': tmp_path / 'sweep', **changes}
    with pytest.raises(api.InputError, match=words):
        api.sweep(**asked)
    assert not asked['folder'].exists()


def test_a_run_sees_features_or_images() -> None:
    with pytest.raises(api.InputError, match="source must be one of features, images, got 'vid"):
        api.simulate(START, source='video')
