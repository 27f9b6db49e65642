"""What is not installed: the rest works, and one line says what is missing and what to do."""

from collections.abc import Sequence
from pathlib import Path
import subprocess
import sys

from command_line import COMMAND, environment, TINY
import pytest

from visual_servo_epipolar.commands.main import main, parser
from visual_servo_epipolar.nodes.startup.missing import remedy

# Read by every Python that is started with its folder on PYTHONPATH, workers of a sweep as well.
BLOCKER = """
import sys
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] in {packages!r}:
            raise ModuleNotFoundError(f'No module named {{name!r}}', name=name)
sys.meta_path.insert(0, Blocker())
"""
CAMERA = """
image_width: 320
image_height: 240
camera_matrix: {data: [192, 0, 159.5, 0, 192, 119.5, 0, 0, 1]}
"""
BAGS = ('rosbags', 'mcap')
START = ('--start', '0.3', '-2.2', '0', '--scenario', 'tiny.yaml')
SIMULATE = ('simulate', *START, '--out', 'out', '--json', 'result.json')
SWEEP = ('sweep', '--region', 'front', '--runs', '2', '--jobs', '1', '--scenario', 'tiny.yaml')
INSPECT = ('inspect', 'a.png', 'a.png', '--camera', 'camera.yaml', '--out', 'overlay.png')
DEMO = ('demo', *START, '--no-video', '--out', 'out')


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    from visual_servo_epipolar.files import write_whole
    from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
    from visual_servo_epipolar.simulation.scenario import load

    cv2 = pytest.importorskip('cv2')
    (tmp_path / 'tiny.yaml').write_text(f'{TINY}run: {{max_duration: 1.0}}')
    (tmp_path / 'camera.yaml').write_text(CAMERA)
    photograph = CameraSimulator(load(tmp_path / 'tiny.yaml').camera).photograph()
    write_whole(tmp_path / 'a.png', cv2.imencode('.png', photograph)[1].tobytes())
    return tmp_path


def started(
    folder: Path, text: str, *arguments: str, module: str = 'sitecustomize'
) -> subprocess.CompletedProcess[str]:
    """Run Python where ``module``, of that ``text``, is found before all others."""
    (folder / 'first').mkdir()
    (folder / f'first/{module}.py').write_text(text)
    command = [sys.executable, *arguments]
    env = environment(folder / 'first')
    return subprocess.run(
        command, cwd=folder, env=env, capture_output=True, text=True, timeout=120
    )


def without(
    packages: Sequence[str], folder: Path, *words: str
) -> subprocess.CompletedProcess[str]:
    return started(folder, BLOCKER.format(packages=packages), *COMMAND[1:], *words)


def test_what_is_free_of_ros_works_without_ros_and_without_bags(folder: Path) -> None:
    commands = (SIMULATE, (*SWEEP, '--out', 'out'), INSPECT, ('gains', '--json', 'gains.json'))
    code = f'from {main.__module__} import main; print(*map(main, {commands}))'
    ended = started(folder, BLOCKER.format(packages=('rclpy', *BAGS)), '-c', code)
    assert (ended.returncode, ended.stderr) == (0, '')
    # A second is too short to arrive, and the same photograph twice has no epipoles.
    assert ended.stdout.splitlines()[-1] == '1 0 1 0'
    written = ('out/trajectory.png', 'result.json', 'out/map.png', 'overlay.png', 'gains.json')
    assert all((folder / name).is_file() for name in written)


@pytest.mark.long
def test_the_demo_works_without_the_libraries_of_bags(folder: Path) -> None:
    pytest.importorskip('rclpy')
    ended = without(BAGS, folder, *DEMO, '--bag', 'none')
    assert ended.returncode == 1, ended.stderr
    assert 'not arrived within 1 s' in ended.stdout
    assert (folder / 'out/result.json').is_file()


LIBRARIES = ('numpy', 'cv2', 'yaml', 'matplotlib', 'rclpy', 'dask', 'scipy', *BAGS)


@pytest.mark.parametrize('name', ['', *parser().commands])
def test_help_comes_at_once_for_it_loads_no_library(tmp_path: Path, name: str) -> None:
    ended = without(LIBRARIES, tmp_path, *filter(None, [name]), '--help')
    assert (ended.returncode, ended.stderr) == (0, '')
    assert ended.stdout.startswith(f'usage: {" ".join(filter(None, ["visual_servo", name]))}')


ROS_LINE = (
    'ROS 2 cannot be imported ({}); source your ROS 2 Jazzy, or run "make setup" and use .venv'
)
BAG_LINE = (
    ' is missing; pip install rosbags mcap (on Ubuntu 24.04 in a venv with '
    '--system-site-packages), or --bag none'
)


@pytest.mark.parametrize(
    ('package', 'arguments', 'line'),
    [
        ('rclpy', DEMO, ROS_LINE.format("No module named 'rclpy'")),
        (
            'matplotlib',
            ('reproduce', 'sim1', '--out', 'out'),
            'matplotlib is missing; apt install',
        ),
        ('rosbags', DEMO, f'rosbags{BAG_LINE}'),
        ('mcap', DEMO, f'mcap{BAG_LINE}'),
        ('matplotlib', DEMO, 'matplotlib is missing; apt install python3-matplotlib'),
        ('matplotlib', SIMULATE, 'matplotlib, or leave out --out'),
        ('matplotlib', SWEEP, 'matplotlib is missing; apt install python3-matplotlib'),
        (
            'distributed',
            (*SWEEP[:5], '--scheduler', 'tcp://127.0.0.1:1', '--out', 'out'),
            'distributed is missing; pip install "visual_servo_epipolar[dask]", or leave',
        ),
    ],
)
def test_what_is_missing_is_reported_first(
    folder, monkeypatch, capsys, package, arguments, line
) -> None:
    if arguments is DEMO:
        pytest.importorskip('rclpy')
    monkeypatch.chdir(folder)
    monkeypatch.setitem(sys.modules, package, None)  # as Python marks what cannot be imported
    assert main(arguments) == 2
    shown = capsys.readouterr()
    assert (shown.out, len(shown.err.splitlines())) == ('', 1)
    assert line in shown.err
    assert not list(folder.rglob('*.json*'))


@pytest.mark.long
def test_what_is_there_and_cannot_be_loaded_is_reported_when_it_is_to_draw(folder: Path) -> None:
    pytest.importorskip('rclpy')
    broken = "raise ImportError('libfreetype.so: no such file')"
    words = (*COMMAND[1:], *DEMO, '--bag', 'none')
    ended = started(folder, broken, *words, module='matplotlib')
    assert ended.returncode == 2, ended.stderr
    said = 'visual_servo demo: libfreetype.so: no such file; install what it needs'
    assert said in ended.stderr.splitlines()
    assert 'Traceback' not in ended.stderr
    assert (folder / 'out/run.json').is_file()


@pytest.mark.parametrize(
    ('error', 'words'),
    [
        *(
            (ModuleNotFoundError('it is not there', name=name), ROS_LINE.format('it is not there'))
            for name in ('rclpy._rclpy_pybind11', 'sensor_msgs.msg', 'std_srvs')
        ),
        (ImportError('libx.so: cannot open'), 'libx.so: cannot open; install'),
    ],
)
def test_what_is_missing_has_a_remedy(error: ImportError, words: str) -> None:
    assert remedy(error).startswith(words)


def test_a_module_of_our_own_that_is_missing_is_a_defect() -> None:
    error = ModuleNotFoundError('x', name='visual_servo_epipolar.core.other')
    with pytest.raises(ModuleNotFoundError):
        remedy(error)
