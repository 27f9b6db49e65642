"""Latency over the wire: every image is answered; what processes cost, and that they end."""

from contextlib import ExitStack, suppress
import json
import os
import signal
import subprocess
import sys

import numpy as np
import pytest

pytest.importorskip('rclpy')

from node_process import environment
from small_cameras import SMALL

from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.evaluation.benchmarks import latency
from visual_servo_epipolar.evaluation.benchmarks.latency import Answers, DOMAIN, driven
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.simulation.cameras import CameraSettings

CAMERA = CameraSettings(**SMALL, frame_rate=20.0)


def test_an_answer_is_known_by_the_stamp_of_its_image() -> None:
    drive = Answers(sent={100: 0.0, 200: 0.0, 300: 0.0})
    for stamp_ns, linear in ((100, 0.0), (300, 0.2), (400, 0.3)):
        drive.take(write.twist_stamped(Twist(linear, 0.0), stamp_ns, 'base_link'))
    assert (len(drive.latencies), drive.moving) == (2, 1)


def test_the_robot_in_the_images_moves() -> None:
    images = driven(CAMERA, 3.0).images
    assert len(images) == 3.0 * CAMERA.frame_rate
    moved = np.abs(images[0].astype(float) - images[-1]) > 5.0 * CAMERA.noise
    assert moved.mean() > 0.05


def test_no_image_is_from_after_the_end_of_a_run(monkeypatch) -> None:
    monkeypatch.setattr(latency, 'START', (0.0, 0.0, 0.0))
    assert 0 < len(driven(CAMERA, 20.0).images) < 20.0 * CAMERA.frame_rate


@pytest.mark.alone
def test_nodes_answer_and_the_cost_of_each_process_is_counted() -> None:
    document = latency.run(seed=0, quick=True, say=lambda text: None)
    text = latency.table(json.loads(json.dumps(document)))
    assert '640x480, 60 Hz' in text and 'servo_node' in text
    (row,) = document['rows']
    nodes = row['nodes']
    assert 0 <= nodes['drops'] < nodes['images'] and nodes['moving'] > 0.0
    assert 0.0 < nodes['p50'] <= nodes['p99'] <= nodes['p99.9']
    assert len(row['processes']) == 2
    for cost in row['processes'].values():
        assert cost['processor_ms'] > 0.0
        assert 0.0 < min(cost['memory_mb'])


END_SEC = 8.0
# Nodes whose session is their own, and who print to where this one prints.
NODES = """
from contextlib import ExitStack

from visual_servo_epipolar.commands.main import terminable
from visual_servo_epipolar.evaluation.benchmarks.latency import start_nodes

with terminable(), ExitStack() as stack:
    (node,) = start_nodes(stack, {'unicycle_node': ()}).values()
    print(node.pid, flush=True)
    node.wait()
"""


def kill(pid: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, signal.SIGKILL)


@pytest.mark.parametrize('number', ['SIGTERM', 'SIGKILL'])
def test_nodes_end_with_the_process_that_started_them(number: str) -> None:
    with ExitStack() as stack:
        process = stack.enter_context(
            subprocess.Popen(
                [sys.executable, '-c', NODES],
                env=environment(DOMAIN),
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        )
        stack.callback(process.kill)
        stack.callback(kill, int(process.stdout.readline()))
        process.send_signal(signal.Signals[number])
        assert process.communicate(timeout=END_SEC) == (b'', None)  # closed by the node as well
