"""Managed nodes as processes: refused in one line, led over the wire, ended in any state."""

from contextlib import ExitStack
from itertools import count
from pathlib import Path
import signal
import sys
import time
from typing import Any

from bench import Bench, next_domain
from durations import few_of
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from lifecycles import asked
from node_process import arguments, environment, started
import pytest
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from visual_servo_epipolar.messages import write

START_SEC, END_SEC = 60.0, 30.0
NODES = ('servo_node', 'tracker_node', 'recorder_node', 'dock_node', 'route_node')


def assert_ends(process: Any, log: Path) -> None:
    assert process.wait(END_SEC) == 0, log.read_text()
    assert 'Traceback' not in log.read_text()


def test_a_process_survives_the_impossible_and_ends_in_any_state(stack, tmp_path) -> None:
    domain = next_domain()
    bench, processes = stack.enter_context(Bench(domain)), {}
    for name in NODES:
        command = arguments(name, '-p', 'autostart_node:=false')
        processes[name] = started(stack, environment(domain), command, tmp_path / name)
    for place, name in enumerate(NODES):  # one ends unconfigured, one inactive, others active
        for number in (99, 3, *(1, 1, 3, 3)[: 2 * place]):
            bench.call(f'{name}/change_state', ChangeState, asked(number))
        state = bench.call(f'{name}/get_state', GetState).current_state.label
        assert state == ('unconfigured', 'inactive', 'active', 'active', 'active')[place]
        processes[name].send_signal(signal.SIGINT)
        assert_ends(processes[name], tmp_path / name)


@pytest.mark.parametrize('name', few_of(NODES))
def test_shutdown_ends_the_process(stack, tmp_path, name) -> None:
    domain, log = next_domain(), tmp_path / 'log'
    bench = stack.enter_context(Bench(domain))
    process = started(stack, environment(domain), arguments(name), log)
    request = asked(Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert bench.call(f'{name}/change_state', ChangeState, request).success
    assert_ends(process, log)


@pytest.mark.long
def test_each_of_200_signals_ends_a_tracker_that_loads_or_tracks(
    stack, tmp_path, simulator, view
) -> None:
    domain, stops, log = next_domain(), 200, tmp_path / 'log'
    load = 'from visual_servo_epipolar.nodes.startup.executables import tracker_node as run; run()'
    bench, stamps = stack.enter_context(Bench(domain)), count(1)
    clouds = bench.listen(PointCloud2, 'tracks')
    camera, images = bench.talk(CameraInfo, 'camera_info'), bench.talk(Image, 'image_raw')

    def see() -> None:
        camera(write.camera_info(simulator.camera, stamp := next(stamps), 'camera'))
        images(write.image(view, 'mono8', stamp, 'camera'))

    bench.probe.create_timer(0.03, see)
    began = time.monotonic()
    for number in range(stops):
        with ExitStack() as own:
            process = started(own, environment(domain), [sys.executable, '-c', load], log)
            if number == 0:
                bench.until(lambda: bool(clouds), 'tracks', START_SEC)
                loading_s = time.monotonic() - began
            end = time.monotonic() + 1.3 * loading_s * number / stops
            bench.until(lambda end=end: time.monotonic() >= end, 'its time', START_SEC)
            process.terminate()
            # Python itself has no handler yet, and none any more.
            assert process.wait(END_SEC) in (0, -signal.SIGTERM), log.read_text()
