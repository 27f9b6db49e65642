"""
Latency benchmark: from an image on the wire to the twist on the wire.

The camera is this process; images are those of a run that the servo has driven before.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import count
import math
import os
from pathlib import Path
import signal
import subprocess
import sys
from tempfile import TemporaryDirectory
import time
from typing import Any, NamedTuple

from geometry_msgs.msg import TwistStamped
import numpy as np
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from visual_servo_epipolar import processes
from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.stamps import period_ns
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.evaluation.tables import aligned
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.startup.run import isolated_context, new_executor, spin_once
from visual_servo_epipolar.processes import ONE_THREAD
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator, ImageView
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.closed_loop import Loop, LoopSettings

# Its own among benchmarks that run at a time, and above those that people use.
DOMAIN = 216 + os.getpid() % 16
NODES = 'visual_servo_epipolar.nodes'
RELIABLE = ('-p', 'camera_reliability:=reliable')
# A twist with a stamp is known to answer the image of that stamp.
STAMPED = ('-p', 'autostart:=true', '-p', 'enable_stamped_cmd_vel:=true')
TRACKER_AND_SERVO = {'tracker_node': RELIABLE, 'servo_node': (*RELIABLE, *STAMPED)}
START_S = 60.0  # in which nodes start and answer

Process = subprocess.Popen[bytes]


def start_nodes(
    stack: ExitStack, nodes: Mapping[str, Sequence[str]], folder: Path
) -> dict[str, Process]:
    """
    Start each node of ours, by name, with its arguments in ``folder``.

    They are in sessions of their own, and end with ``stack``, and with this process, however that
    ends.
    """
    path = os.pathsep.join(filter(None, map(os.path.abspath, sys.path)))
    own = {'ROS_DOMAIN_ID': str(DOMAIN), 'PYTHONPATH': path}
    started = {}
    for name, words in nodes.items():
        command = [sys.executable, '-m', processes.__name__, str(os.getpid()), f'{NODES}.{name}']
        started[name] = stack.enter_context(
            subprocess.Popen(
                [*command, '--ros-args', *words],
                cwd=folder,
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


FRAME_ID = 'camera_optical_frame'
START = (1.0, -3.5, 8.0)  # x, y [m], heading error [deg]; it takes half a minute from there


@dataclass(slots=True)
class Answers:
    """A stretch of time: when images were sent, and the latencies of the answers."""

    sent: dict[int, float] = field(default_factory=dict)  # by stamp [ns], on the steady clock [s]
    latencies: list[float] = field(default_factory=list)  # image sent to twist received [s]
    twists: list[Twist] = field(default_factory=list)

    def __iadd__(self, other: 'Answers') -> 'Answers':
        self.sent |= other.sent
        self.latencies += other.latencies
        self.twists += other.twists
        return self

    def took(self, message: TwistStamped) -> None:
        """Take the answer to an image."""
        sent = self.sent.get(read.stamp_ns(message.header))
        if sent is not None:
            self.latencies.append(time.monotonic() - sent)
            self.twists.append(read.twist(message))

    @property
    def moving(self) -> int:
        """How many twists are not zero."""
        return sum(twist != STANDSTILL for twist in self.twists)


class PlayedCamera:
    """
    Nodes in processes of their own; this process is their camera, and hears their twists.

    ``nodes`` are names with their arguments; they run in ``folder``.
    """

    def __init__(
        self,
        stack: ExitStack,
        camera: CameraModel,
        folder: Path,
        nodes: Mapping[str, Sequence[str]],
    ) -> None:
        context = stack.enter_context(isolated_context('LOCALHOST', domain_id=DOMAIN))
        self.node: Node = rclpy.create_node('bench_camera', context=context)
        stack.callback(self.node.destroy_node)
        self._executor = new_executor(context)
        self._executor.add_node(self.node)
        self.drive = Answers()
        self.node.create_subscription(TwistStamped, 'cmd_vel', self._on_answer, qos.COMMAND)
        self._camera, self._numbers = camera, count()
        self._image_pub = self.node.create_publisher(Image, 'image_raw', qos.STREAM)
        self._info_pub = self.node.create_publisher(CameraInfo, 'camera_info', qos.STREAM)
        self._desired_pub = self.node.create_publisher(Image, 'desired/image_raw', qos.LATCHED)
        self.processes = start_nodes(stack, nodes, folder)

    def call(self, service: str) -> str:
        """Call a service of std_srvs/Trigger, and return what it says."""
        client = self.node.create_client(Trigger, service)
        try:
            if not client.wait_for_service(START_S):
                raise VisualServoError(f'no node served {service} within {START_S:g} s')
            future: Any = client.call_async(Trigger.Request())
            self._executor.spin_until_future_complete(future, START_S)
            answer = future.result()
        finally:
            self.node.destroy_client(client)
        if answer is None or not answer.success:
            raise VisualServoError(f'{service} failed: {answer and answer.message}')
        return str(answer.message)

    def show_goal(self, photograph: Pixels, images: Sequence[Pixels]) -> None:
        """Publish the photograph, and ``images`` until the servo answers to them."""
        self._desired_pub.publish(write.image(photograph, 'mono8', 0, FRAME_ID))
        deadline = time.monotonic() + START_S
        while not self.show(images, LEAD_RATE).latencies:
            if time.monotonic() > deadline:
                raise VisualServoError(f'no image was answered within {START_S:g} s')

    def show(self, images: Sequence[Pixels], rate: float) -> Answers:
        """Publish these images at ``rate`` [Hz], stamped as they are due; return the answers."""
        self.drive = drive = Answers()
        begin_ns, begin = self.node.get_clock().now().nanoseconds, time.monotonic()
        for number, image in enumerate(images):
            self._spin_until(begin + number / rate)
            self._publish(image, begin_ns + number * period_ns(rate))
        self._spin_until(time.monotonic() + 0.5)
        return drive

    def _spin_until(self, moment: float) -> None:
        while (remaining := moment - time.monotonic()) > 0.0:
            spin_once(self._executor, remaining)

    def _publish(self, image: Pixels, stamp_ns: int) -> None:
        image = image.copy()
        # No camera takes the very same image twice, and the servo does not drive by one.
        image[0, :4] = list(next(self._numbers).to_bytes(4, 'big'))
        message = write.image(image, 'mono8', stamp_ns, FRAME_ID)
        self._info_pub.publish(write.camera_info(self._camera, stamp_ns, FRAME_ID))
        self.drive.sent[stamp_ns] = time.monotonic()
        self._image_pub.publish(message)

    def _on_answer(self, message: TwistStamped) -> None:
        self.drive.took(message)


# Images at rest before the run, in which the tracker finds the photograph.
LEAD, LEAD_RATE = 10, 10.0


class DrivenRun(NamedTuple):
    """Run that the servo has driven: its ``images``, shape (H, W), none after its end."""

    camera: CameraModel
    rate: float
    photograph: Pixels
    images: Sequence[Pixels]


def driven(settings: CameraSettings, seconds: float, folder: Path) -> DrivenRun:
    """
    Drive from START for ``seconds`` [s], or to the end of the run before that.

    Images are in a file of ``folder``, which has to stay: 20 s of 1280x1024 at 30 Hz are 0.8 GB.
    """
    simulator, rate = CameraSimulator(settings), settings.frame_rate
    view = ImageView(simulator, Tracker(TrackerSettings()))
    for image in [simulator.capture(Pose.from_start(*START), 0)] * LEAD:
        view.tracker.track(image)
    shape = round(seconds * rate), settings.height, settings.width
    images = np.memmap(folder / 'images', np.uint8, 'w+', shape=shape)
    kept = 0

    def keep(sample: Sample) -> None:
        nonlocal kept
        if not sample.phase.ended and kept < len(images):
            images[kept] = view.image
            kept += 1

    loop = LoopSettings(start=START, seed=settings.seed, frame_rate=rate, max_duration=seconds)
    Loop(loop, view, simulator.camera).run(watch=keep)
    images.flush()  # nothing is to be written while latencies are measured
    return DrivenRun(simulator.camera, rate, view.desired, tuple(np.asarray(images)[:kept]))


OPTIONS = ('seconds',)  # of the command line that this benchmark takes
FULL = CameraSettings(frame_rate=30.0)
CELLS = (
    replace(
        FULL,
        width=640,
        height=480,
        focal_length=FULL.focal_length / 2.0,
        principal_u=319.5,
        principal_v=239.5,
        frame_rate=60.0,
    ),
    FULL,
)
SECONDS, QUICK_SECONDS = 60.0, 4.0
TURN_S = 20.0  # at most, of the run that is shown again and again [s]
LATENCIES = 'size and rate | p50 | p99 | p99.9 | images | drops'
COSTS = 'size and rate | process | processor ms a frame | memory MB'
QUANTILES = {'p50': 0.5, 'p99': 0.99, 'p99.9': 0.999}


def run(
    *, seed: int, quick: bool, say: Callable[[str], None], seconds: float | None = None
) -> dict[str, Any]:
    """Return the document: for each size of image latency, drops and costs."""
    seconds = seconds or (QUICK_SECONDS if quick else SECONDS)
    rows = [
        _measure_size(replace(cell, seed=seed), seconds, say)
        for cell in (CELLS[:1] if quick else CELLS)
    ]
    return {'seconds': seconds, 'rows': rows}


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


def spent(costs: Sequence[tuple[Cost, Cost]], frames: int) -> dict[str, Any]:
    """Return what ``frames`` cost, from the costs before and after each stretch that counts."""
    processor_s = sum(after.processor_s - before.processor_s for before, after in costs)
    return {
        'processor_ms': 1e3 * processor_s / max(frames, 1),
        'memory_mb': [costs[0][0].memory_mb, costs[-1][1].memory_mb],
    }


def _measure_size(
    settings: CameraSettings, seconds: float, say: Callable[[str], None]
) -> dict[str, Any]:
    """Return the row of one size: latencies, drops, and what each process costs."""
    size, rate = [settings.width, settings.height], settings.frame_rate
    title, turns = f'{size[0]}x{size[1]} at {rate:g} Hz', max(1, math.ceil(seconds / TURN_S))
    answers, costs = Answers(), {name: list[tuple[Cost, Cost]]() for name in TRACKER_AND_SERVO}
    with TemporaryDirectory(prefix='visual_servo_') as scratch, ExitStack() as stack:
        say(f'{title}: driving ...')
        run = driven(settings, seconds / turns, Path(scratch))
        say(f'{title}: starting nodes ...')
        loop = PlayedCamera(stack, run.camera, Path(scratch), TRACKER_AND_SERVO)
        loop.show_goal(run.photograph, run.images[:LEAD])
        for turn in range(turns):
            say(f'{title}: turn {turn + 1} of {turns}, {seconds / turns:g} s ...')
            _begin(loop, run)
            before = {name: Cost.of(loop.processes[name]) for name in costs}
            answers += loop.show(run.images, rate)
            for name, stretches in costs.items():
                stretches.append((before[name], Cost.of(loop.processes[name])))
    processes = {name: spent(it, len(answers.sent)) for name, it in costs.items()}
    return {'size': size, 'rate': rate, 'nodes': _answers(answers), 'processes': processes}


def _begin(loop: PlayedCamera, run: DrivenRun) -> None:
    """Show the start of a run while the servo is stopped, and start it anew."""
    loop.call('servo_node/stop')
    loop.call('tracker_node/redetect')
    for images in (run.images[:1], [run.images[0]] * (LEAD - 1)):  # the first takes a while
        loop.show(images, LEAD_RATE)
    for service in ('reset', 'start'):
        loop.call(f'servo_node/{service}')


def _answers(drive: Answers) -> dict[str, Any]:
    """Return quantiles [ms] of the latencies, and how many images have no answer."""
    if not drive.latencies:
        raise VisualServoError(
            'no image was answered; start the nodes by hand and read their logs'
        )
    values = 1e3 * np.quantile(drive.latencies, list(QUANTILES.values()))
    return {
        'images': len(drive.sent),
        'drops': len(drive.sent) - len(drive.latencies),
        'moving': drive.moving / len(drive.latencies),
        **{name: float(value) for name, value in zip(QUANTILES, values, strict=True)},
    }


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: latencies, then what each process costs."""
    rows = document['rows']
    costs = (_cost(_title(row), *it) for row in rows for it in row['processes'].items())
    return '\n'.join(
        [
            'Latency, image on the wire to twist on the wire; tracker and servo, '
            f'{document["seconds"]:g} s a row, [ms]',
            '',
            *aligned(LATENCIES, map(_latencies, rows)),
            '',
            *aligned(COSTS, costs, left=2),
        ]
    )


def _latencies(row: Mapping[str, Any]) -> list[str]:
    nodes = row['nodes']
    quantiles = [f'{nodes[name]:.1f}' for name in QUANTILES]
    return [_title(row), *quantiles, *(str(nodes[name]) for name in ('images', 'drops'))]


def _cost(title: str, name: str, it: Mapping[str, Any]) -> list[str]:
    memory = ' -> '.join(f'{each:.0f}' for each in it['memory_mb'])
    return [title, name, f'{it["processor_ms"]:.1f}', memory]


def _title(row: Mapping[str, Any]) -> str:
    width, height = row['size']
    return f'{width}x{height}, {row["rate"]:g} Hz'
