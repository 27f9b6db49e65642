"""Node and memory are one: what is taught and repeated over messages is so to the last bit."""

from dataclasses import asdict
from functools import partial
import json
from pathlib import Path

from bagmaker import Message, write_bag
from diagnostic_msgs.msg import DiagnosticArray
import numpy as np
import pytest
from rclpy.parameter import Parameter as RosParameter
from rclpy.serialization import serialize_message
from route_rig import RouteRig
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.registry import with_intrinsics
from visual_servo_epipolar.core.geometry.motion import Pose, Twist
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.routes.run import RouteStep
from visual_servo_epipolar.core.routes.settings import FollowSettings
from visual_servo_epipolar.core.stamps import period_ns
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.messages.route_folder import read_route, write_route
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.simulation.bases import PioneerSettings
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.routes import (
    driven_in,
    repeat,
    rounded,
    route_scenario,
    Taught,
    teach,
)
from visual_servo_epipolar.simulation.scenario import Scenario

SCENARIO = route_scenario(Scenario(base=PioneerSettings(wheel_ratio=1.01)), 1).with_servo(
    {'law': 'smooth', 'latency': 0.0}
)
TOLD = {
    '/route_node/settings': (String, qos.LATCHED),
    '/route_node/events': (String, qos.DIAGNOSTICS),
    '/route_node/progress': (JointState, qos.DIAGNOSTICS),
    '/diagnostics': (DiagnosticArray, qos.DIAGNOSTICS),
}
IMAGES = 20  # of the short comparison, in which it finds itself and follows


WAY = rounded(((3.0, -3.9), (3.0, -2.7)))
shown: list[tuple[Image, int, Pose]] = []  # images of the drive, stamps, odometry


@pytest.fixture(scope='module')
def taught() -> Taught:
    return teach(SCENARIO, WAY, watch=lambda *what: shown.append(what))


@pytest.mark.long
def test_a_way_that_is_recorded_is_the_one_of_memory(bench, tmp_path: Path, taught) -> None:
    rig = RouteRig(bench, tmp_path / 'hall', SCENARIO.camera.nominal_camera)
    rig.see(shown[0][0], 0)
    assert rig.call('start_recording')[0]
    for image, stamp_ns, odometry in shown:
        rig.see(image, stamp_ns, odometry)
        rig.bench.until(lambda: rig.node._recording.behind < 20, 'images to be learnt from')
    rig.bench.settle()
    success, text = rig.call('stop_recording')
    assert success, text
    write_route(taught.route, tmp_path / 'memory')
    recorded, expected = read_route(tmp_path / 'hall'), read_route(tmp_path / 'memory')
    assert recorded.length == expected.length
    for one, other in zip(recorded.views, expected.views, strict=True):
        assert np.array_equal(one.image, other.image)
        # Headings of odometry are quaternions on their way: their last bits are others.
        depths = one.structure.inverse_depth, other.structure.inverse_depth
        np.testing.assert_allclose(*depths, rtol=1e-6)
        np.testing.assert_allclose(one.path.poses, other.path.poses, atol=1e-8)


def test_a_way_that_is_repeated_is_the_one_of_memory(bench, tmp_path: Path, taught) -> None:
    compare(bench, tmp_path, taught, IMAGES)


@pytest.mark.long
def test_a_whole_way_is_the_one_of_memory_up_to_its_station(bench, tmp_path, taught) -> None:
    compare(bench, tmp_path, taught, 10_000)


def test_a_repetition_in_a_bag_replays_to_the_last_bit(bench, tmp_path, taught, capsys) -> None:
    """Also where it was stopped by an image of another size, or slowed down by a parameter."""
    write_route(taught.route, tmp_path / 'hall')
    scenario, start = SCENARIO.seeded(5), taught.stations[0]
    values = {**asdict(scenario.servo), 'watchdog': False}
    messages: list[Message] = []

    def listen(name: str, raw: bytes, *_: object) -> None:  # the executor of events adds an info
        messages.append((name, len(messages), bytes(raw)))

    for name, (kind, profile) in TOLD.items():
        bench.probe.create_subscription(kind, name, partial(listen, name), profile, raw=True)
    camera = with_intrinsics(scenario.camera.nominal_camera, cx=321.0)  # calibrated anew
    rig = RouteRig(bench, tmp_path / 'hall', camera, **values)
    info = bytes(serialize_message(write.camera_info(camera, 0, 'camera')))
    messages.append(('/camera_info', len(messages), info))
    base, simulator = scenario.base.base(start, seed=6), CameraSimulator(scenario.camera)
    begun, text = rig.call('repeat')
    assert begun and 'the camera was calibrated anew: cx 319.5 -> 321, rays up to 0.22 deg' in text
    speeds: list[float] = []
    for k in range(16):
        image = simulator.capture(base.pose, k)
        if k == 10:
            rig.see(image[::2, ::2], base.now_ns)
        else:
            if k == 8:
                rig.node.set_parameters([RosParameter('max_speed', value=0.06)])
            told = rig.answered(image, base.now_ns)
            speeds.append(told.linear)
            base.command(Command(told))
            shown = write.image(image, 'mono8', base.now_ns, 'camera')
            messages.append(('/image_raw', len(messages), bytes(serialize_message(shown))))
        base.advance(base.now_ns + period_ns(scenario.camera.frame_rate))
    bench.until(lambda: sum(it[0] == '/route_node/progress' for it in messages) == 15, 'steps')
    assert speeds[7] > 0.09 and max(speeds[8:]) <= 0.06  # from the next image on
    kinds = {'/route_node/progress': 'sensor_msgs/msg/JointState'}
    kinds |= {f'/route_node/{name}': 'std_msgs/msg/String' for name in ('settings', 'events')}
    bag = write_bag(tmp_path / 'bag', messages, kinds=kinds)
    assert main(['route', 'replay', str(bag)]) == 0
    said = capsys.readouterr().out
    assert 'recorded and replayed: 15 steps, the same to the last bit' in said
    assert 'localizing' in said and 'following' in said
    changed = ['route', 'replay', str(bag), '--set', 'follow.max_speed=0.05', '--json', '-']
    assert main(changed) == 1
    replayed = json.loads(capsys.readouterr().out)
    assert replayed['changes'] == {'follow': {'max_speed': 0.05}}
    speeds = [step['linear_m_s'] for step in replayed['steps'].values()]
    assert len(speeds) == 15 and 0.03 < max(speeds) <= 0.05
    assert main([*changed[:4], 'max_speed=0.05']) == 2
    assert 'did you mean follow.max_speed?' in capsys.readouterr().err
    # What happened between two images counts: without it the robot drove on.
    kept = [each for each in messages if b'"held"' not in each[2]]
    assert len(kept) == len(messages) - 1
    bag = write_bag(tmp_path / 'other', kept, kinds=kinds)
    assert main(['route', 'replay', str(bag)]) == 1
    silent = [each for each in messages if each[0] != '/route_node/progress']
    assert main(['route', 'replay', str(write_bag(tmp_path / 'silent', silent, kinds=kinds))]) == 2
    assert 'no steps of /route_node to compare with' in capsys.readouterr().err
    # A route that was renewed since is another.
    with open(tmp_path / 'hall/route.yaml', 'a', encoding='utf-8') as file:
        file.write('# renewed\n')
    assert main(['route', 'replay', str(bag)]) == 2
    assert 'is not the route that was repeated' in capsys.readouterr().err


def compare(bench, folder: Path, taught: Taught, images: int) -> None:
    """Repeat a way by a node and in memory, up to so many ``images``, and compare commands."""
    write_route(taught.route, folder / 'hall')
    taught = Taught(read_route(folder / 'hall'), taught.way, taught.stations)
    scenario, start = SCENARIO.seeded(5), taught.stations[0]
    expected: list[tuple[Twist, str]] = []
    poses: list[Pose] = []

    def watch(image, pose: Pose, step: RouteStep) -> None:
        if len(expected) == images:
            raise StopIteration
        expected.append((step.twist, step.phase))
        poses.append(pose)

    try:
        repeat(scenario, taught, FollowSettings(), start=start, watch=watch)
    except StopIteration:
        pass
    values = {**asdict(scenario.servo), 'watchdog': False}
    rig = RouteRig(bench, folder / 'hall', scenario.camera.nominal_camera, **values)
    driven, simulator = driven_in(scenario, start, 6), CameraSimulator(scenario.camera)
    assert rig.call('repeat')[0]
    for k, (twist, phase) in enumerate(expected):
        assert driven.pose == poses[k], k
        told = rig.answered(simulator.capture(driven.exposed_at, k), driven.now_ns)
        assert (told, rig.node.phase) == (twist, phase), k
        driven.drive(Command(told))
    assert len(expected) == images or expected[-1][1] == 'arrived'
