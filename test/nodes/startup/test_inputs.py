"""Inputs that do not come: the node says what it waits for, and why it may not come."""

import os
from pathlib import Path
import signal
import subprocess
import sys
import threading

from bench import Bench, next_domain
import pytest
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import parameters, qos, recorder_node
from visual_servo_epipolar.nodes.camera_node import CameraNode
from visual_servo_epipolar.nodes.recorder_node import RecorderNode
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.nodes.startup import complaints
from visual_servo_epipolar.nodes.tracker_node import TrackerNode

ROOT = Path(__file__).parents[3]
START_SEC, END_SEC = 60.0, 30.0
BEST_EFFORT = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.fixture
def impatient(monkeypatch):
    """Let nodes look often and miss things early; return the list of their looks."""
    monkeypatch.setattr(complaints, 'LOOK_PERIOD_S', 0.05)
    monkeypatch.setattr(complaints, 'PATIENCE_S', 0.3)
    monkeypatch.setattr(complaints, 'REPEAT_S', 60.0)
    looks, look = [], complaints.Inputs.look
    monkeypatch.setattr(complaints.Inputs, 'look', lambda self: (looks.append(self), look(self)))
    return looks


def start(bench, kind, *words, **values):
    """Start a node as its main function does."""
    overrides = [parameters.override(name, value) for name, value in values.items()]
    arguments = ['--ros-args', *words]
    node = kind(context=bench.context, cli_args=arguments, parameter_overrides=overrides)
    complaints.watch(node)
    return bench.add(node)


def until_said(bench, text) -> None:
    bench.until(lambda: bench.logged(text), text)


def test_a_tracker_without_a_camera_says_where_it_listens(bench, impatient) -> None:
    start(bench, TrackerNode, '-r', 'image_raw:=/cam/image_raw', '-r', '__ns:=/robot1')
    until_said(bench, 'waits for images on /cam/image_raw (0 publishers); start')
    until_said(bench, 'waits for the calibration of the camera on /robot1/camera_info (0 publ')


def test_a_camera_without_a_robot_says_so(bench, impatient) -> None:
    start(bench, CameraNode, width=320, height=240)
    until_said(bench, 'waits for the pose of the simulated robot on /ground_truth (0 publishers)')


def test_a_servo_without_tracks_says_so(bench, impatient) -> None:
    start(bench, ServoNode)
    until_said(bench, 'waits for tracks of features on /tracks (0 publishers)')
    until_said(bench, 'waits for the calibration of the camera on /camera_info (0 publishers)')


def test_it_is_said_once_and_then_now_and_then(bench, impatient, monkeypatch) -> None:
    monkeypatch.setattr(complaints, 'REPEAT_S', 0.6)
    start(bench, ServoNode)
    bench.until(lambda: len(bench.logged('waits for tracks')) == 2, 'a second time')
    assert len(impatient) > 5


def test_what_comes_is_not_waited_for(bench, impatient, monkeypatch) -> None:
    monkeypatch.setattr(complaints, 'PATIENCE_S', 60.0)  # until it has come
    image, info = bench.talk(Image, 'image_raw'), bench.talk(CameraInfo, 'camera_info')
    start(bench, TrackerNode)
    info(write.camera_info(Camera(4, 3, 5.0, 5.0, 2.0, 1.5), 0, 'camera'))
    bench.settle()
    monkeypatch.setattr(complaints, 'PATIENCE_S', 0.3)
    image(Image())
    bench.until(lambda: bench.logged('image refused'), 'the image to arrive')
    # The camera falls silent; its calibration holds.
    until_said(bench, 'waits for images on /image_raw (1 publisher)')
    assert not bench.logged('waits for the calibration')


def test_best_effort_images_for_a_reliable_tracker_are_explained(bench, impatient) -> None:
    bench.talk(Image, 'image_raw', BEST_EFFORT)
    start(bench, TrackerNode, camera_reliability='reliable')
    until_said(bench, 'waits for images on /image_raw (1 publisher); their QoS does not fit: Best')
    (text,) = bench.logged('waits for images')
    assert text.endswith('; set camera_reliability: auto')


def test_a_publisher_that_fits_is_named_alone(bench, impatient) -> None:
    bench.talk(Image, 'image_raw', BEST_EFFORT)
    bench.talk(Image, 'image_raw', qos.STREAM)
    start(bench, TrackerNode, camera_reliability='reliable')
    until_said(bench, 'waits for images on /image_raw (2 publishers)')
    (text,) = bench.logged('waits for images')
    assert text.endswith('(2 publishers); nothing comes from /probe')


def test_messages_of_another_type_are_explained(impatient, monkeypatch) -> None:
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    domain = next_domain()
    # In a context of its own, as in another process: one alone takes a single type for a topic.
    with Bench(domain) as bench, Bench(domain) as driver:
        driver.talk(CompressedImage, 'image_raw')
        start(bench, TrackerNode)
        kinds = 'they are sensor_msgs/msg/CompressedImage, it takes sensor_msgs/msg/Image'
        until_said(bench, f'waits for images on /image_raw (1 publisher); {kinds}')


def test_a_recorder_names_the_topics_that_nobody_publishes(bench, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(recorder_node, 'PATIENT_DISCOVERIES', 1)
    start(bench, RecorderNode, bag=str(tmp_path / 'bag'), topics=('words', 'rosout'))
    until_said(bench, 'waits for /words (0 publishers)')


def test_simulated_time_without_a_clock_is_said_once(bench, impatient) -> None:
    start(bench, ServoNode, use_sim_time=True)
    until_said(bench, 'use_sim_time is true: the stamps do not advance; is /clock published?')
    count = len(impatient)
    bench.until(lambda: len(impatient) > count + 3, 'three more looks')
    assert len(bench.logged('use_sim_time is true')) == 1


def test_simulated_time_with_a_clock_is_not_complained_about(bench, impatient) -> None:
    tick = bench.talk(Clock, '/clock')
    node = bench.start(ServoNode, use_sim_time=True)
    bench.until(lambda: tick(write.clock(5)) or node.get_clock().now().nanoseconds == 5, 'time')
    complaints.watch(node)
    until_said(bench, 'waits for tracks')
    assert not bench.logged('use_sim_time is true')


def test_a_node_that_runs_by_itself_says_what_it_waits_for() -> None:
    command = [sys.executable, '-m', 'visual_servo_epipolar.nodes.tracker_node', '--ros-args']
    environment = {
        **os.environ,
        'PYTHONPATH': os.pathsep.join(filter(None, [str(ROOT), os.environ.get('PYTHONPATH')])),
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'OFF',
    }
    with subprocess.Popen(
        [*command, '-p', 'use_sim_time:=true'],
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        timeout = threading.Timer(START_SEC, process.kill)  # then there are no more lines
        timeout.start()
        try:
            lines = iter(process.stderr.readline, '')
            said = [line for _, line in zip(range(3), lines, strict=False)]
            process.send_signal(signal.SIGINT)
            assert process.wait(END_SEC) == 0, f'it has said {said} in {START_SEC:g} s'
        finally:
            timeout.cancel()
            process.kill()
    assert any('waits for images on /image_raw (0 publishers)' in line for line in said), said
    assert any('is /clock published?' in line for line in said), said
