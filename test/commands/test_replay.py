"""``visual_servo replay`` as its users meet it."""

import json
from pathlib import Path
import re
import shutil

from bagmaker import decoded, kind_of, TYPES, write_bag
from command_line import document, refusal
import cv2
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CameraInfo, Image

from visual_servo_epipolar.commands import replay
from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.messages import read, write


@pytest.fixture(scope='module')
def bag(small_run, tmp_path_factory) -> str:
    return str(write_bag(tmp_path_factory.mktemp('bags') / 'run', small_run))


@pytest.fixture(scope='module')
def driver(small_run, tmp_path_factory) -> str:
    """Return a bag of the camera alone."""
    recorded = [item for item in small_run if item[0] in ('/image_raw', '/camera_info')]
    return str(write_bag(tmp_path_factory.mktemp('bags') / 'driver', recorded[:30]))


def test_the_recorded_parameters_give_the_same_and_exit_0(bag, capsys) -> None:
    assert main(['replay', bag]) == 0
    output = capsys.readouterr().out
    assert 'the same to the last bit' in output
    assert 'x real time' in output
    assert 'displacing' in output


def test_other_parameters_exit_1_say_where_they_part_and_draw_it(bag, tmp_path, capsys) -> None:
    out = tmp_path / 'out ä'
    changes = '--set', 'servo.max_angular_acceleration=0.4'
    assert main(['replay', bag, '--tracks', *changes, '--out', str(out)]) == 1
    output = capsys.readouterr().out
    assert 'servo.max_angular_acceleration = 0.4' in output
    assert 'recorded and replayed diverge at 0.0' in output
    assert 'angular_rad_s: recorded ' in output
    assert 'quantity' in output
    assert json.loads((out / 'replay.json').read_text())['comparison']['equal'] is False
    assert cv2.imread(str(out / 'replay.png')).shape[1] > 800
    assert sorted(path.name for path in out.iterdir()) == ['replay.json', 'replay.png']


def test_the_json_is_that_of_a_run_with_the_comparison(bag, capsys) -> None:
    changes = '--set', 'servo.k1=0.1', 'servo.k_t=1e1'
    code = main(['replay', bag, '--tracks', *changes, '--json', '-'])
    result = json.loads(capsys.readouterr().out)
    assert result['source'] == 'tracks'
    assert result['changes'] == {'servo': {'k1': 0.1, 'k_t': 10.0}}
    assert {'outcome', 'phases', 'position_error_m', 'start', 'attempts'} <= result.keys()
    assert result['start'] == pytest.approx([0.3, -2.2, 0.0])
    assert result['reason'].startswith('the bag ends in ')
    assert result['comparison']['compared_steps'] == result['steps']
    assert code == (0 if result['comparison']['equal'] else 1)


def rounded(run: list, folder: Path, difference: float, numpy: str = '1.21.5') -> str:
    """Return a bag recorded with another numpy, which differs a little in one number."""
    messages = list(run)
    changed = [k for k, message in enumerate(run) if message[0] == '/epipoles'][29]
    for k, (topic, log_ns, _) in enumerate(run):
        if topic.endswith('/settings'):
            text = re.sub(r'# numpy: \S+', f'# numpy: {numpy}', decoded(run[k]).data)
            messages[k] = topic, log_ns, bytes(serialize_message(write.text(text)))
    message = decoded(run[changed])
    message.position = message.position.copy()
    message.position[list(message.name).index('psi_rad')] += difference
    raw = bytes(TYPES.serialize_cdr(message, kind_of('/epipoles')))
    messages[changed] = (*run[changed][:2], raw)
    return str(write_bag(folder / 'rounded', messages))


def test_another_numpy_is_named_and_what_it_rounds_is_within_a_tolerance(
    small_run, tmp_path, capsys
) -> None:
    path = rounded(small_run, tmp_path, 3e-10)
    assert main(['replay', path, '--tracks', '--tolerance', '1e-9']) == 0
    shown = capsys.readouterr().out
    assert 'the same within 1e-09' in shown
    assert f'note: recorded with numpy 1.21.5, replayed with numpy {np.__version__}' in shown
    result = document(capsys, 'replay', path, '--tracks', code=1)
    assert result['comparison']['parting']
    assert result['versions']['recorded']['numpy'] == '1.21.5'
    assert result['versions']['replayed']['numpy'] == np.__version__


def test_a_repaired_bag_asks_for_no_repair_again(small_run, tmp_path, capsys) -> None:
    cut = [(t, at, raw[:9] if t == '/camera_info' else raw) for t, at, raw in small_run[:40]]
    path = str(write_bag(tmp_path / 'run', cut))
    assert 'try --repair' in refusal(capsys, 'replay', path)
    error = refusal(capsys, 'replay', path, '--repair')
    assert 'bag cannot be read' in error
    assert '--repair' not in error


@pytest.mark.parametrize(
    ('where', 'ending'),
    [('replay_bag', KeyboardInterrupt), ('write_json', OSError(28, 'No space left on device'))],
)
def test_nothing_is_left_of_a_replay_cut(
    bag, tmp_path, capsys, monkeypatch, ending, where
) -> None:
    def end(*_: object, **__: object) -> None:
        raise ending

    monkeypatch.setattr(replay, where, end)
    out = tmp_path / 'made' / 'out'
    assert main(['replay', bag, '--tracks', '--out', str(out)]) in (2, 130)
    assert list(tmp_path.iterdir()) == []
    (kept := tmp_path / 'kept').mkdir()
    (kept / 'replay.json').write_text('of before')
    assert main(['replay', bag, '--tracks', '--out', str(kept)]) in (2, 130)
    assert [path.name for path in kept.iterdir()] == ['replay.json']
    assert (kept / 'replay.json').read_text() == 'of before'


@pytest.fixture
def photograph(small_run, tmp_path) -> str:
    image = next(decoded(item) for item in small_run if item[0] == '/desired/image_raw')
    path = tmp_path / 'goal.png'
    assert cv2.imwrite(str(path), read.gray(image))
    return str(path)


def test_a_driver_with_a_photograph_in_a_file(driver, photograph, capsys) -> None:
    result = document(capsys, 'replay', driver, '--desired', photograph)
    assert result['comparison']['compared_steps'] == 0
    assert result['position_error_m'] is None
    assert (len(result['notes']), result['steps']) == (2, 15)
    for image, reason in (
        (cv2.resize(cv2.imread(photograph, 0), (400, 300)), 'must have the size of the desired'),
        (np.full((256, 320), 90, np.uint8), 'the desired image cannot be used'),
    ):
        cv2.imwrite(photograph, image)
        assert reason in refusal(capsys, 'replay', driver, '--desired', photograph)


def test_a_driver_with_a_photograph_out_of_the_bag_and_a_camera_file(
    driver, small_run, tmp_path, capsys
) -> None:
    recorded = [item for item in small_run if item[0] == '/image_raw'][:10]
    path = write_bag(tmp_path / 'images', recorded)
    camera = tmp_path / 'camera.yaml'
    camera.write_text(
        'image_width: 320\nimage_height: 256\n'
        'camera_matrix: {data: [192.3, 0, 158.375, 0, 192.3, 127.625, 0, 0, 1]}\n'
    )
    assert main(['replay', str(path), '--desired', '+0.5', '--camera', str(camera)]) == 0
    assert 'nothing was recorded to compare with' in capsys.readouterr().out


def test_a_bag_cut_short_is_refused_and_replayed_once_repaired(bag, tmp_path, capsys) -> None:
    path = shutil.copytree(bag, tmp_path / 'cut')
    (path / 'metadata.yaml').unlink()
    file = next(path.glob('*.mcap'))
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert 'was left open by a crash, try --repair' in refusal(capsys, 'replay', str(path))
    result = document(capsys, 'replay', str(path), '--repair')
    assert 'run.repaired.mcap holds' in result['notes'][0]
    assert 10 < result['steps'] < 50
    assert main(['replay', str(path)]) == 0  # and it stays so


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        *((['--set', it], 'takes SECTION.') for it in ('k1=0.1', 'camera.width=3', 'servo.k1')),
        (['--set', 'servo.k_1=0.1'], 'servo has no setting k_1; did you mean k1'),
        (['--set', 'servo.k1=often'], "k1 must be float, got 'often'"),
        (['--set', 'servo.k1=-1'], 'k1 must lie in [0, 5], got -1'),
        (['--set', 'servo.k1={a'], 'k1 must be float'),
        (['--set', 'tracker.min_features=500'], 'min_features must not exceed max_features'),
        (['--topics', 'picture=/image_raw'], '--topics takes ROLE=NAME with a role of image'),
        (['--desired', 'nowhere.png'], "--desired must be an image file or a stamp [s], got 'now"),
        (['--desired', 'nan'], '--desired must be'),
        (['--desired', '77'], 'no image was taken at 77.000 s'),
        (['--tolerance', '-1'], "'-1' is negative"),
        (['--camera', 'nowhere.yaml'], 'nowhere.yaml: camera file cannot be read: No such file'),
        (['--out', __file__], 'nothing can be written there: Not a directory'),
    ],
)
def test_bad_input_is_one_line(bag, capsys, arguments, reason) -> None:
    assert reason in refusal(capsys, 'replay', bag, *arguments)


def two_cameras(small_run, folder, image_frame: str, info_frame: str) -> str:
    """Return a bag of the images of one camera beside the camera_info of another."""
    topics = {'/image_raw': '/cam/color/image_raw', '/camera_info': '/cam/depth/camera_info'}
    told = {'/image_raw': (Image, image_frame), '/camera_info': (CameraInfo, info_frame)}
    made = []
    for topic, log_ns, raw in [item for item in small_run if item[0] in topics][:30]:
        message = deserialize_message(raw, told[topic][0])
        message.header.frame_id = told[topic][1]
        made.append((topics[topic], log_ns, serialize_message(message)))
    kinds = {new: kind_of(old) for old, new in topics.items()}
    return str(write_bag(folder / 'two', made, kinds=kinds))


def test_a_camera_info_of_another_is_asked_about(small_run, tmp_path, capsys, photograph) -> None:
    path = two_cameras(small_run, tmp_path, 'color', 'depth')
    goal, topic = ('--desired', photograph), 'camera_info=/cam/depth/camera_info'
    assert (
        f'/cam/depth/camera_info is of the frame depth, /cam/color/image_raw of color: it is '
        f"another camera's; say which: --topics {topic}"
    ) in refusal(capsys, 'replay', path, *goal)
    assert main(['replay', path, *goal, '--topics', topic]) == 0


@pytest.mark.parametrize(
    ('frames', 'noted'),
    [
        *((it, 'in two namespaces, and no frame_id tells') for it in (('color', ''), ('', ''))),
        (('color', '/color'), 'by their frame_id alone'),
    ],
)
def test_what_looks_alike_is_noted(small_run, tmp_path, capsys, photograph, frames, noted) -> None:
    path = two_cameras(small_run, tmp_path, *frames)
    result = document(capsys, 'replay', path, '--desired', photograph)
    assert any(noted in note and '/cam/depth/camera_info' in note for note in result['notes'])
