"""
Latency benchmark: from an image on the wire to the twist on the wire.

The floor beside it, in the same run by turns: an echo node that answers each image of the same
size by an empty twist, and what tracker and servo take for the same images in memory: one upon the
other, and at the rate at which they come. The camera is this process; images are those of a run
that the servo has driven before: it commands now as it did, and is as sure of where it is.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from itertools import cycle, islice
import math
import os
from pathlib import Path
from tempfile import TemporaryDirectory
import time
from time import perf_counter, sleep
from typing import Any

from geometry_msgs.msg import TwistStamped
import numpy as np
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL, Twist
from visual_servo_epipolar.core.perception.observation import observe
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.servo.step import decide, update_map
from visual_servo_epipolar.core.stamps import period_ns
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.evaluation.live import echo
from visual_servo_epipolar.evaluation.live.processes import (
    arguments,
    Listener,
    Process,
    start_nodes,
    START_S,
)
from visual_servo_epipolar.evaluation.tables import aligned
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator, ImageView
from visual_servo_epipolar.simulation.closed_loop import run as drive
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.run_monitor import LoopSettings

RELIABLE = arguments(camera_reliability='reliable')
# A twist with a stamp is known to answer the image of that stamp.
TRACKER_AND_SERVO = {
    'tracker_node': RELIABLE,
    'servo_node': (*RELIABLE, *arguments(autostart='true', enable_stamped_cmd_vel='true')),
}
ECHO = {echo.__name__: ()}
FRAME_ID = 'camera_optical_frame'
START = (1.0, -3.5, 8.0)  # x, y [m], heading error [deg]; it takes half a minute from there
WARM_UP_S, SETTLE_S = 1.0, 0.5
COUNTER_BYTES = 4


@dataclass(slots=True)
class Answers:
    """A stretch of time: when images were sent, and the latencies of the answers."""

    sent: dict[int, float] = field(default_factory=dict)  # by stamp [ns], on the steady clock [s]
    latencies: list[float] = field(default_factory=list)  # image sent to twist received [s]
    twists: list[Twist] = field(default_factory=list)
    answered: list[int] = field(default_factory=list)  # stamps of the images, as answers came [ns]

    def __iadd__(self, other: 'Answers') -> 'Answers':
        self.sent |= other.sent
        self.latencies += other.latencies
        self.twists += other.twists
        self.answered += other.answered
        return self

    def took(self, message: TwistStamped) -> None:
        """Take the answer to an image."""
        stamp_ns = read.stamp_ns(message.header)
        sent = self.sent.get(stamp_ns)
        if sent is not None:
            self.answered.append(stamp_ns)
            self.latencies.append(time.monotonic() - sent)
            self.twists.append(read.twist(message))

    @property
    def moving(self) -> int:
        """How many twists are not zero."""
        return sum(twist != STANDSTILL for twist in self.twists)

    @property
    def numbers(self) -> list[int]:
        """Which of the images were answered, as answers came: 0 is the first that was sent."""
        order = {stamp_ns: number for number, stamp_ns in enumerate(self.sent)}
        return [order[stamp_ns] for stamp_ns in self.answered]


class PlayedCamera(Listener):
    """
    Nodes in processes of their own; this process is their camera, and hears their twists.

    The camera shows the ``images`` over and over. ``nodes`` are names with their arguments; they
    run in ``folder``, where bags go.
    """

    def __init__(
        self,
        stack: ExitStack,
        camera: CameraModel,
        images: Sequence[Pixels],
        folder: Path,
        nodes: Mapping[str, Sequence[str]],
    ) -> None:
        super().__init__(stack, 'bench_camera')
        self.drive = Answers()
        for topic in ('cmd_vel', echo.ANSWERS):
            self.node.create_subscription(TwistStamped, topic, self._on_answer, qos.COMMAND)
        self._camera, self._images, self._count = camera, cycle(images), 0
        self._image_pub = self.node.create_publisher(Image, 'image_raw', qos.STREAM)
        self._echo_pub = self.node.create_publisher(Image, echo.IMAGES, qos.STREAM)
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

    def show_goal(self, photograph: Pixels) -> None:
        """Publish the photograph, and wait until the servo answers to images."""
        self._desired_pub.publish(write.image(photograph, 'mono8', 0, FRAME_ID))
        self.wait(
            lambda: bool(self.show(1.0, 10.0).latencies), 'the servo has answered to no image'
        )
        self.show(WARM_UP_S, 10.0)

    def show(self, seconds: float, rate: float, *, to_echo: bool = False) -> Answers:
        """Publish images for ``seconds`` [s] at ``rate`` [Hz], and return the answers."""
        images = list(islice(self._images, round(seconds * rate)))
        return self.show_each(images, rate, to_echo=to_echo)

    def show_each(
        self, images: Sequence[Pixels], rate: float, *, to_echo: bool = False
    ) -> Answers:
        """Publish these images at ``rate`` [Hz], stamped as they are due; return the answers."""
        publisher = self._echo_pub if to_echo else self._image_pub
        self.drive = drive = Answers()
        begin_ns, begin = self.node.get_clock().now().nanoseconds, time.monotonic()
        for number, image in enumerate(images):
            self._spin_until(begin + number / rate)
            self._publish(publisher, image, begin_ns + number * period_ns(rate))
        self.spin_for(SETTLE_S)
        return drive

    def wait_for_echo(self) -> None:
        """Wait until the echo subscribes to images."""
        self.wait(lambda: self._echo_pub.get_subscription_count() > 0, 'no echo has come')

    def _publish(self, publisher: Any, image: Pixels, stamp_ns: int) -> None:
        image = image.copy()
        self._count += 1
        # No camera takes the very same image twice, and the servo does not drive by one.
        image[0, :COUNTER_BYTES] = list(self._count.to_bytes(COUNTER_BYTES, 'big'))
        message = write.image(image, 'mono8', stamp_ns, FRAME_ID)
        if publisher is self._image_pub:
            self._info_pub.publish(write.camera_info(self._camera, stamp_ns, FRAME_ID))
        self.drive.sent[stamp_ns] = time.monotonic()
        publisher.publish(message)

    def _on_answer(self, message: TwistStamped) -> None:
        self.drive.took(message)


LEAD = 10  # images at rest before the run, in which the tracker finds the photograph
SAME_LINEAR, SAME_ANGULAR = 1e-3, math.radians(0.5)  # to which two twists are the same [SI]


@dataclass(frozen=True, slots=True, eq=False)
class DrivenRun:
    """
    Run that the servo has driven: what the robot saw, and what it was commanded.

    ``images``, N arrays of shape (H, W) at ``rate`` [Hz], come one after the other from the start,
    none after the end of the run; ``twists`` are the N answers.
    """

    camera: CameraModel
    rate: float
    photograph: Pixels
    images: Sequence[Pixels]
    twists: Sequence[Twist]

    @property
    def lead(self) -> list[Pixels]:
        """Images before the run: the first, again and again."""
        return [self.images[0]] * LEAD

    def stamp_ns(self, number: int) -> int:
        """Return the time of an image since the first [ns]."""
        return number * period_ns(self.rate)


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
    twists: list[Twist] = []

    def keep(sample: Sample) -> None:
        if not sample.phase.ended and len(twists) < len(images):
            images[len(twists)] = view.image
            twists.append(sample.twist)

    loop = LoopSettings(start=START, seed=settings.seed, frame_rate=rate, max_duration=seconds)
    drive(loop, view, simulator.camera, watch=keep)
    images.flush()  # nothing is to be written while latencies are measured
    seen = tuple(np.asarray(images)[: len(twists)])
    return DrivenRun(simulator.camera, rate, view.desired, seen, twists)


def are_same(one: Twist, other: Twist) -> bool:
    """Return whether two twists are the same, but for what stamps and rounding make of them."""
    linear, angular = abs(one.linear - other.linear), abs(one.angular - other.angular)
    return linear <= SAME_LINEAR and angular <= SAME_ANGULAR


def in_memory(run: DrivenRun, *, paced: bool = False) -> dict[str, float]:
    """
    Return the medians [ms] of tracker and servo: ``tracker_ms``, ``servo_ms``.

    What a twist waits for; what prepares for the next image after that is not counted. If
    ``paced``, images come at their rate, and not one upon the other: a processor that has slept
    in between finds little in its caches, as in the nodes.
    """
    medians = 1e3 * np.median([times for times, _ in steps(run, paced=paced)], axis=0)
    return dict(zip(('tracker_ms', 'servo_ms'), map(float, medians), strict=True))


def steps(run: DrivenRun, *, paced: bool = False) -> Iterator[tuple[tuple[float, float], Twist]]:
    """Yield, for each image of the run, the times of tracker and servo [s], and the twist."""
    tracker, settings, state = Tracker(TrackerSettings()), ServoSettings(), ServoState()
    tracker.set_desired(run.photograph)
    for image in run.lead:
        tracker.track(image)
    first = perf_counter()
    for number, image in enumerate(run.images):
        if paced:
            sleep(max(first + number / run.rate - perf_counter(), 0.0))
        began = perf_counter()
        features = tracker.track(image)
        tracked = perf_counter()
        observation = observe(features, run.camera, run.stamp_ns(number))
        state = decide(state, observation, settings)
        yield (tracked - began, perf_counter() - tracked), state.twist
        state = update_map(state)  # the twist does not wait for it
        tracker.prepare()


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
TURN_S = 20.0  # at most, nodes and echo by turns: load from elsewhere hits both
LEAD_RATE = 10.0  # of images before a run [Hz]
ECHO_SHARE = 0.25  # of the time of the nodes
LATENCIES = (
    'size and rate | p50 | p99 | p99.9 | images | drops | as driven | echo p50 '
    '| echo p99 | tracker | servo | floor | ratio | tracker, servo, floor at the rate | its ratio'
)
COSTS = 'size and rate | process | processor ms a frame | memory MB | peak'
QUANTILES = {'p50': 0.5, 'p99': 0.99, 'p99.9': 0.999}


class TwoNodes:
    """Tracker and servo; their camera is this process."""

    def __init__(self, loop: PlayedCamera, run: DrivenRun) -> None:
        self._loop, self._run = loop, run
        self.processes = {name: loop.processes[name] for name in TRACKER_AND_SERVO}
        self.as_driven = 0

    def wait_for_answers(self) -> None:
        """Show the photograph, and images until they are answered."""
        self._loop.show_goal(self._run.photograph)

    def begin(self) -> None:
        """Show the start while the servo is stopped, and start it anew."""
        self._loop.call('servo_node/stop')
        self._loop.call('tracker_node/redetect')
        first, *lead = self._run.lead
        self._loop.show_each([first], LEAD_RATE)  # to find the photograph takes a while
        self._loop.show_each(lead, LEAD_RATE)
        for service in ('reset', 'start'):
            self._loop.call(f'servo_node/{service}')

    def turn(self, seconds: float) -> Answers:
        """Show the run from its start on, and to its end at most."""
        run = self._run
        drive = self._loop.show_each(run.images[: round(seconds * run.rate)], run.rate)
        answers = zip(drive.numbers, drive.twists, strict=True)
        self.as_driven += sum(are_same(twist, run.twists[number]) for number, twist in answers)
        return drive


def run(
    *, seed: int, quick: bool, say: Callable[[str], None], seconds: float | None = None
) -> dict[str, Any]:
    """Return the document: for each size of image latency, floor, drops and costs."""
    seconds = seconds or (QUICK_SECONDS if quick else SECONDS)
    rows = [
        _measure_size(replace(cell, seed=seed), seconds, say)
        for cell in (CELLS[:1] if quick else CELLS)
    ]
    return {'seconds': seconds, 'rows': rows}


@dataclass(frozen=True, slots=True)
class Cost:
    """What a process has cost up to now: processor time [s], resident memory and its peak [MB]."""

    processor_s: float
    memory_mb: float
    peak_mb: float

    @classmethod
    def of(cls, process: Process) -> 'Cost':
        """Read what the kernel knows of a process."""
        # User and system time are fields 14 and 15; the name before them may hold blanks.
        fields = Path(f'/proc/{process.pid}/stat').read_text().rpartition(')')[2].split()
        ticks = int(fields[11]) + int(fields[12])
        status = dict(
            line.split(':', 1)
            for line in Path(f'/proc/{process.pid}/status').read_text().splitlines()
        )
        resident, peak = (int(status[key].split()[0]) * 1024 / 1e6 for key in ('VmRSS', 'VmHWM'))
        return cls(ticks / os.sysconf('SC_CLK_TCK'), resident, peak)


Stretch = tuple[Mapping[str, Cost], Mapping[str, Cost]]  # costs before and after it


def costs(processes: Mapping[str, Process]) -> dict[str, Cost]:
    """Return what each process has cost up to now."""
    return {name: Cost.of(process) for name, process in processes.items()}


def spent(stretches: Sequence[Stretch], frames: int) -> dict[str, dict[str, Any]]:
    """
    Return what ``frames`` cost each process: processor [ms a frame], memory [MB].

    ``stretches`` are the costs before and after each stretch of time that counts.
    """
    first, last = stretches[0][0], stretches[-1][1]

    def processor_s(name: str) -> float:
        return sum(after[name].processor_s - it[name].processor_s for it, after in stretches)

    return {
        name: {
            'processor_ms': 1e3 * processor_s(name) / max(frames, 1),
            'memory_mb': [it.memory_mb, last[name].memory_mb],
            'peak_mb': last[name].peak_mb,
        }
        for name, it in first.items()
    }


def _measure_size(
    settings: CameraSettings, seconds: float, say: Callable[[str], None]
) -> dict[str, Any]:
    """Return the row of one size: latencies, floor, drops, and what each process costs."""
    size, rate = [settings.width, settings.height], settings.frame_rate
    title, run_s = f'{size[0]}x{size[1]} at {rate:g} Hz', seconds / _turns(seconds)
    with TemporaryDirectory(prefix='visual_servo_') as scratch, ExitStack() as stack:
        say(f'{title}: driving for {run_s:g} s ...')
        run = driven(settings, run_s, Path(scratch))
        say(f'{title}: tracker and servo in memory ...')
        floor, paced = in_memory(run), in_memory(run, paced=True)
        say(f'{title}: starting nodes ...')
        loop = PlayedCamera(
            stack, run.camera, run.images, Path(scratch), {**ECHO, **TRACKER_AND_SERVO}
        )
        chain = TwoNodes(loop, run)
        chain.wait_for_answers()
        loop.wait_for_echo()
        row = _by_turns(chain, loop, rate, seconds, lambda text: say(f'{title}: {text}'))
    echo = row['echo']['p50']
    floors = {'floor': _floor(echo, floor), 'paced_floor': _floor(echo, paced)}
    return {'size': size, 'rate': rate, **floors, **row}


def _floor(echo_ms: float, in_memory_ms: dict[str, float]) -> dict[str, float]:
    parts = {'echo_ms': echo_ms, **in_memory_ms}
    return {**parts, 'sum_ms': sum(parts.values())}


def _turns(seconds: float) -> int:
    return max(1, math.ceil(seconds / TURN_S))


def _by_turns(
    chain: TwoNodes,
    loop: PlayedCamera,
    rate: float,
    seconds: float,
    say: Callable[[str], None],
) -> dict[str, Any]:
    """Drive nodes and echo by turns, and return what both took."""
    turns = _turns(seconds)
    nodes, echoes = Answers(), Answers()
    stretches: list[Stretch] = []
    for turn in range(turns):
        say(f'turn {turn + 1} of {turns}, {seconds / turns:g} s and its echo ...')
        chain.begin()
        before = costs(chain.processes)
        nodes += chain.turn(seconds / turns)
        stretches.append((before, costs(chain.processes)))
        echoes += loop.show(ECHO_SHARE * seconds / turns, rate, to_echo=True)
    return {
        'nodes': {**_answers(nodes), 'as_driven': chain.as_driven / len(nodes.twists)},
        'echo': _answers(echoes),
        'processes': spent(stretches, len(nodes.sent)),
    }


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
    """Return the document as text: latencies and floor, then what each process costs."""
    rows = document['rows']
    costs_of = [(_title(row), name, it) for row in rows for name, it in row['processes'].items()]
    return '\n'.join(
        [
            'Latency, image on the wire to twist on the wire; tracker and servo, '
            f'{document["seconds"]:g} s a row, [ms]',
            '',
            *aligned(LATENCIES, map(_latencies, rows)),
            '',
            *aligned(COSTS, (_cost(*each) for each in costs_of), left=2),
        ]
    )


def _latencies(row: Mapping[str, Any]) -> list[str]:
    nodes, echo, floor, paced = (row[it] for it in ('nodes', 'echo', 'floor', 'paced_floor'))
    return [
        _title(row),
        *(f'{nodes[name]:.1f}' for name in QUANTILES),
        *(str(nodes[name]) for name in ('images', 'drops')),
        f'{nodes["as_driven"]:.1%}',
        *(f'{echo[name]:.1f}' for name in ('p50', 'p99')),
        *(f'{floor[f"{name}_ms"]:.1f}' for name in ('tracker', 'servo', 'sum')),
        f'{nodes["p50"] / floor["sum_ms"]:.2f}',
        f'{paced["tracker_ms"]:.1f}, {paced["servo_ms"]:.1f}, {paced["sum_ms"]:.1f}',
        f'{nodes["p50"] / paced["sum_ms"]:.2f}',
    ]


def _cost(title: str, name: str, it: Mapping[str, Any]) -> list[str]:
    memory = ' -> '.join(f'{each:.0f}' for each in it['memory_mb'])
    return [title, name, f'{it["processor_ms"]:.1f}', memory, f'{it["peak_mb"]:.0f}']


def _title(row: Mapping[str, Any]) -> str:
    width, height = row['size']
    return f'{width}x{height}, {row["rate"]:g} Hz'
