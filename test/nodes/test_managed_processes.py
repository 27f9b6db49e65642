"""Managed nodes as processes: refused in one line, led over the wire, ended in any state."""

from contextlib import ExitStack
from itertools import count
import signal
import subprocess
import sys
import time

from bench import Bench, next_domain
from durations import few_of
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from lifecycles import asked
from node_process import arguments, environment
import pytest
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from visual_servo_epipolar.messages import write

START_SEC, END_SEC = 60.0, 30.0
NODES = ('servo_node', 'tracker_node', 'recorder_node', 'dock_node', 'route_node')


@pytest.fixture
def wide_open(monkeypatch) -> None:
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')


def test_a_process_survives_the_impossible_and_ends_in_any_state(wide_open, tmp_path) -> None:
    domain = next_domain()
    with ExitStack() as stack:
        bench, processes = stack.enter_context(Bench(domain)), {}
        for name in NODES:
            log = stack.enter_context((tmp_path / name).open('w'))
            command = arguments(name, '-p', 'autostart_node:=false')
            processes[name] = stack.enter_context(
                subprocess.Popen(
                    command,
                    env=environment(domain),
                    stderr=log,
                    cwd=tmp_path,
                    start_new_session=True,
                )
            )
            stack.callback(processes[name].kill)
        for place, name in enumerate(NODES):  # one ends unconfigured, one inactive, others active
            for number in (99, 3, *(1, 1, 3, 3)[: 2 * place]):
                bench.call(f'{name}/change_state', ChangeState, asked(number))
            state = bench.call(f'{name}/get_state', GetState).current_state.label
            assert state == ('unconfigured', 'inactive', 'active', 'active', 'active')[place]
            processes[name].send_signal(signal.SIGINT)
            assert processes[name].wait(END_SEC) == 0, (tmp_path / name).read_text()
            assert 'Traceback' not in (tmp_path / name).read_text()


@pytest.mark.parametrize('name', few_of(NODES))
def test_shutdown_ends_the_process(wide_open, tmp_path, name) -> None:
    domain = next_domain()
    command = arguments(name)
    with Bench(domain) as bench, (tmp_path / 'log').open('w') as log:
        options = {'cwd': tmp_path, 'env': environment(domain), 'start_new_session': True}
        with subprocess.Popen(command, stderr=log, **options) as process:
            try:
                request = asked(Transition.TRANSITION_ACTIVE_SHUTDOWN)
                assert bench.call(f'{name}/change_state', ChangeState, request).success
                assert process.wait(END_SEC) == 0, (tmp_path / 'log').read_text()
            finally:
                process.kill()
    assert 'Traceback' not in (tmp_path / 'log').read_text()


@pytest.mark.long
def test_each_of_200_signals_ends_a_tracker_that_loads_or_tracks(
    wide_open, tmp_path, simulator, view
) -> None:
    domain, stops = next_domain(), 200
    load = 'from visual_servo_epipolar.nodes.startup.executables import tracker_node as run; run()'
    options = {'env': environment(domain), 'start_new_session': True}
    with Bench(domain) as bench, (tmp_path / 'log').open('w') as log:
        clouds = bench.listen(PointCloud2, 'tracks')
        camera, images = bench.talk(CameraInfo, 'camera_info'), bench.talk(Image, 'image_raw')
        stamps = count(1)

        def see() -> None:
            camera(write.camera_info(simulator.camera, stamp := next(stamps), 'camera'))
            images(write.image(view, 'mono8', stamp, 'camera'))

        bench.probe.create_timer(0.03, see)
        began = time.monotonic()
        for number in range(stops):
            command = [sys.executable, '-c', load]
            with subprocess.Popen(command, stderr=log, **options) as process:
                try:
                    if number == 0:
                        bench.until(lambda: bool(clouds), 'tracks', START_SEC)
                        loading_s = time.monotonic() - began
                    end = time.monotonic() + 1.3 * loading_s * number / stops
                    bench.until(lambda end=end: time.monotonic() >= end, 'its time', START_SEC)
                    process.terminate()
                    code = process.wait(END_SEC)
                    # Python itself has no handler yet, and none any more.
                    assert code in (0, -signal.SIGTERM), (tmp_path / 'log').read_text()
                finally:
                    process.kill()
