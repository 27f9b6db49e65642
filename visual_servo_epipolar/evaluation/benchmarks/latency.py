"""
Latency benchmark: from an image on the wire to the twist on the wire.

The camera is this process; images are those of a run that the servo has driven before.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import count
import os
from pathlib import Path
import signal
import subprocess
import sys
import time
from typing import Any, NamedTuple

from geometry_msgs.msg import TwistStamped
import numpy as np
import rclpy
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from visual_servo_epipolar import processes
from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.stamps import period_ns
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.evaluation.tables import aligned
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.startup.run import isolated_context, new_executor, spin_once
from visual_servo_epipolar.nodes.startup.settings import CameraRig
from visual_servo_epipolar.processes import ONE_THREAD
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator, ImageView
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.closed_loop import Loop, LoopSettings

# Its own among benchmarks that run at a time, and above those that people use.
DOMAIN = 216 + os.getpid() % 16
RELIABLE = ('-p', 'camera_reliability:=reliable')
NODES: Mapping[str, Sequence[str]] = {
    'tracker_node': RELIABLE,
    # A twist with a stamp answers the image of that stamp.
    'servo_node': (*RELIABLE, '-p', 'autostart:=true', '-p', 'enable_stamped_cmd_vel:=true'),
}
START_S = 60.0  # in which nodes start and answer
START = (1.0, -3.5, 8.0)  # x, y [m], heading error [deg]; it takes half a minute from there
LEAD, LEAD_RATE = 10, 10.0  # images at rest before a run, in which the tracker finds the goal
FULL = CameraSettings(frame_rate=30.0)
HALF = replace(FULL.resized(640, 480), frame_rate=60.0)
TURNS, TURN_S = 6, 10.0  # of a row: a run is shown again and again [s]
QUANTILES = {'p50': 0.5, 'p99': 0.99, 'p99.9': 0.999}

Process = subprocess.Popen[bytes]


def start_nodes(stack: ExitStack, nodes: Mapping[str, Sequence[str]]) -> dict[str, Process]:
    """
    Start each node of ours, by name, with its arguments.

    They are in sessions of their own, and end with ``stack``, and with this process, however that
    ends.
    """
    path = os.pathsep.join(filter(None, map(os.path.abspath, sys.path)))
    own = {'ROS_DOMAIN_ID': str(DOMAIN), 'PYTHONPATH': path}
    started = {}
    for name, words in nodes.items():
        module = f'visual_servo_epipolar.nodes.{name}'
        command = [sys.executable, '-m', processes.__name__, str(os.getpid()), module]
        started[name] = stack.enter_context(
            subprocess.Popen(
                [*command, '--ros-args', *words],
                env={**ONE_THREAD, **os.environ, **own},  # as executables do
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        )
        stack.callback(_end, started[name])
    return started


def _end(process: Process) -> None:
    process.send_signal(signal.SIGCONT)
    process.terminate()
    try:
        process.wait(30.0)  # for a process to end, before it is killed
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


@dataclass(slots=True)
class Answers:
    """When images were sent, the latencies of the answers [s], and how many are not zero."""

    sent: dict[int, float] = field(default_factory=dict)  # by stamp [ns], on the steady clock [s]
    latencies: list[float] = field(default_factory=list)
    moving: int = 0

    def take(self, message: TwistStamped) -> None:
        """Take the answer to an image."""
        sent = self.sent.get(read.stamp_ns(message.header))
        if sent is not None:
            self.latencies.append(time.monotonic() - sent)
            self.moving += read.twist(message) != STANDSTILL


class PlayedCamera:
    """Tracker and servo as ``processes`` of their own; this process is their camera."""

    def __init__(self, stack: ExitStack, camera: CameraModel) -> None:
        context = stack.enter_context(isolated_context('LOCALHOST', domain_id=DOMAIN))
        self._node = rclpy.create_node('bench_camera', context=context)
        stack.callback(self._node.destroy_node)
        self._executor = new_executor(context)
        self._executor.add_node(self._node)
        self._answers = Answers()
        self._node.create_subscription(
            TwistStamped, 'cmd_vel', lambda message: self._answers.take(message), qos.COMMAND
        )
        self._camera, self._numbers = camera, count()
        self._image_pub = self._node.create_publisher(Image, 'image_raw', qos.STREAM)
        self._info_pub = self._node.create_publisher(CameraInfo, 'camera_info', qos.STREAM)
        self._desired_pub = self._node.create_publisher(Image, 'desired/image_raw', qos.LATCHED)
        self.processes = start_nodes(stack, NODES)

    def call(self, service: str) -> None:
        """Call a service of std_srvs/Trigger; VisualServoError if it fails."""
        client = self._node.create_client(Trigger, service)
        if not client.wait_for_service(START_S):
            raise VisualServoError(f'no node served {service} within {START_S:g} s')
        future: Any = client.call_async(Trigger.Request())
        self._executor.spin_until_future_complete(future, START_S)
        answer = future.result()
        self._node.destroy_client(client)
        if answer is None or not answer.success:
            raise VisualServoError(f'{service} failed: {answer and answer.message}')

    def show_goal(self, photograph: Pixels, images: Sequence[Pixels]) -> None:
        """Publish the photograph, and ``images`` until the servo answers to them."""
        self._desired_pub.publish(write.image(photograph, 'mono8', 0, CameraRig.camera_frame))
        deadline = time.monotonic() + START_S
        while not self.show(images, LEAD_RATE, Answers()).latencies:
            if time.monotonic() > deadline:
                raise VisualServoError(f'no image was answered within {START_S:g} s')

    def show(self, images: Sequence[Pixels], rate: float, answers: Answers) -> Answers:
        """Publish these images at ``rate`` [Hz], stamped as they are due; collect the answers."""
        self._answers = answers
        begin_ns, begin = self._node.get_clock().now().nanoseconds, time.monotonic()
        for number, image in enumerate(images):
            self._spin_until(begin + number / rate)
            self._publish(image, begin_ns + number * period_ns(rate))
        self._spin_until(time.monotonic() + 0.5)
        return answers

    def begin(self, still: Pixels) -> None:
        """Show the start of a run while the servo is stopped, and start it anew."""
        self.call('servo_node/stop')
        self.call('tracker_node/redetect')
        for images in ([still], [still] * (LEAD - 1)):  # the first takes a while
            self.show(images, LEAD_RATE, Answers())
        self.call('servo_node/reset')
        self.call('servo_node/start')

    def _spin_until(self, moment: float) -> None:
        while (remaining := moment - time.monotonic()) > 0.0:
            spin_once(self._executor, remaining)

    def _publish(self, image: Pixels, stamp_ns: int) -> None:
        image = image.copy()
        # No camera takes the very same image twice, and the servo does not drive by one.
        image[0, :4] = list(next(self._numbers).to_bytes(4, 'big'))
        message = write.image(image, 'mono8', stamp_ns, CameraRig.camera_frame)
        self._info_pub.publish(write.camera_info(self._camera, stamp_ns, CameraRig.camera_frame))
        self._answers.sent[stamp_ns] = time.monotonic()
        self._image_pub.publish(message)


class DrivenRun(NamedTuple):
    """Run that the servo has driven: its ``images``, shape (H, W), none after its end."""

    camera: CameraModel
    photograph: Pixels
    images: Sequence[Pixels]


def driven(settings: CameraSettings, seconds: float) -> DrivenRun:
    """Drive from START for ``seconds`` [s], or to the end of the run before that."""
    simulator, images = CameraSimulator(settings), list[Pixels]()
    view = ImageView(simulator, Tracker(TrackerSettings()))
    for image in [simulator.capture(Pose.from_start(*START), 0)] * LEAD:
        view.tracker.track(image)

    def keep(sample: Sample) -> None:
        if not sample.phase.ended and len(images) < round(seconds * settings.frame_rate):
            images.append(np.array(view.image))

    loop = LoopSettings(
        start=START, seed=settings.seed, frame_rate=settings.frame_rate, max_duration=seconds
    )
    Loop(loop, view, simulator.camera).run(watch=keep)
    return DrivenRun(simulator.camera, view.desired, images)


def run(*, seed: int, quick: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Return the document: for each size of image latency, drops and costs."""
    sizes, turns, turn_s = ((HALF,), 1, 4.0) if quick else ((HALF, FULL), TURNS, TURN_S)
    return {'rows': [_row(replace(size, seed=seed), turns, turn_s, say) for size in sizes]}


class Cost(NamedTuple):
    """What a process has cost up to now: processor time [s], resident memory [MB]."""

    processor_s: float
    memory_mb: float

    @classmethod
    def of(cls, process: Process) -> 'Cost':
        """Read the kernel's figures of a process."""
        # User and system time are fields 14 and 15; the name before them may hold blanks.
        fields = Path(f'/proc/{process.pid}/stat').read_text().rpartition(')')[2].split()
        ticks, pages = int(fields[11]) + int(fields[12]), int(fields[21])
        return cls(ticks / os.sysconf('SC_CLK_TCK'), pages * os.sysconf('SC_PAGE_SIZE') / 1e6)


def _row(
    settings: CameraSettings, turns: int, seconds: float, say: Callable[[str], None]
) -> dict[str, Any]:
    """Return the row of one size: latencies, drops, and what each process costs."""
    row = {'size': [settings.width, settings.height], 'rate': settings.frame_rate}
    answers, processor_s, begins = Answers(), dict.fromkeys(NODES, 0.0), dict[str, Cost]()
    with ExitStack() as stack:
        say(f'{_title(row)}: driving ...')
        run = driven(settings, seconds)
        say(f'{_title(row)}: starting nodes ...')
        loop = PlayedCamera(stack, run.camera)
        loop.show_goal(run.photograph, run.images[:LEAD])
        for turn in range(turns):
            say(f'{_title(row)}: turn {turn + 1} of {turns}, {seconds:g} s ...')
            loop.begin(run.images[0])
            before = {name: Cost.of(loop.processes[name]) for name in NODES}
            begins = begins or before
            loop.show(run.images, settings.frame_rate, answers)
            ends = {name: Cost.of(loop.processes[name]) for name in NODES}
            for name in NODES:
                processor_s[name] += ends[name].processor_s - before[name].processor_s
    costs = {
        name: {
            'processor_ms': 1e3 * processor_s[name] / len(answers.sent),
            'memory_mb': [begins[name].memory_mb, ends[name].memory_mb],
        }
        for name in NODES
    }
    return {**row, 'seconds': turns * seconds, 'nodes': _quantiles(answers), 'processes': costs}


def _quantiles(answers: Answers) -> dict[str, Any]:
    """Return quantiles [ms] of the latencies, and how many images have no answer."""
    if not answers.latencies:
        raise VisualServoError(
            'no image was answered; start the nodes by hand and read their logs'
        )
    values = 1e3 * np.quantile(answers.latencies, list(QUANTILES.values()))
    return {
        'images': len(answers.sent),
        'drops': len(answers.sent) - len(answers.latencies),
        'moving': answers.moving / len(answers.latencies),
        **{name: float(value) for name, value in zip(QUANTILES, values, strict=True)},
    }


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: latencies, then what each process costs."""
    rows = document['rows']
    costs = [
        [
            _title(row),
            name,
            f'{it["processor_ms"]:.1f}',
            '{:.0f} -> {:.0f}'.format(*it['memory_mb']),
        ]
        for row in rows
        for name, it in row['processes'].items()
    ]
    words = f'tracker and servo, {rows[0]["seconds"]:g} s a row, [ms]'
    return '\n'.join(
        [
            f'Latency, image on the wire to twist on the wire; {words}',
            '',
            *aligned('size and rate | p50 | p99 | p99.9 | images | drops', map(_latencies, rows)),
            '',
            *aligned('size and rate | process | processor ms a frame | memory MB', costs, left=2),
        ]
    )


def _latencies(row: Mapping[str, Any]) -> list[str]:
    nodes = row['nodes']
    quantiles = [f'{nodes[name]:.1f}' for name in QUANTILES]
    return [_title(row), *quantiles, *(str(nodes[name]) for name in ('images', 'drops'))]


def _title(row: Mapping[str, Any]) -> str:
    width, height = row['size']
    return f'{width}x{height}, {row["rate"]:g} Hz'
