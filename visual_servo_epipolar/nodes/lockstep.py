"""Lockstep: all nodes in one process, deterministic and fast; an observer records their run."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import asdict
from pathlib import Path
import time
from typing import Any, TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image, JointState, PointCloud2

from visual_servo_epipolar.bags.recording.settings import RecordSettings
from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.core.laws.phase import unarmed
from visual_servo_epipolar.core.laws.registry import phase_named
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.servo.telemetry import sample
from visual_servo_epipolar.core.settings import Settings
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.nodes.camera_node import CameraNode
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.nodes.startup.run import hand_out, isolated_context, new_node
from visual_servo_epipolar.nodes.tracker_node import TrackerNode
from visual_servo_epipolar.nodes.unicycle_node import UnicycleNode
from visual_servo_epipolar.simulation.closed_loop import LoopSettings, RunMonitor
from visual_servo_epipolar.simulation.scenario import Scenario

if TYPE_CHECKING:
    from visual_servo_epipolar.nodes.recorder_node import RecorderNode

STALL_S = 60.0
SPIN_S = 0.05
TURNS_A_LOOK, LOOK_SPINS = 32, 3  # at timers and services
QUIET_SPINS = 6  # without a message: everything has arrived


class LockstepError(VisualServoError):
    """The chain of nodes stood still, or never got going."""


class Lockstep(AbstractContextManager['Lockstep']):
    """The four nodes in one context, each with simulated time, isolated from other processes."""

    def __init__(self, scenario: Scenario, loop: LoopSettings) -> None:
        self._around = ExitStack()
        self.context = self._around.enter_context(isolated_context())
        self.executor = SingleThreadedExecutor(context=self.context)
        self.nodes: list[Node] = []
        self._turns = 0
        self.recorder: RecorderNode | None = None
        try:
            self._populate(scenario, loop)
        except BaseException:
            self.__exit__()
            raise

    def _populate(self, scenario: Scenario, loop: LoopSettings) -> None:
        base = {'lockstep': True, 'begin': False, 'start': loop.start, 'seed': loop.seed}
        base |= {'frame_rate': loop.frame_rate, 'model': scenario.kind_of('base')}
        base |= {'use_sim_time': False}  # it makes the time
        self.servo = self._add(
            ServoNode,
            scenario.servo,
            {'camera_reliability': 'reliable', 'autostart': True, 'watchdog': False},
        )
        self.tracker = self._add(TrackerNode, scenario.tracker, {'camera_reliability': 'reliable'})
        self.unicycle = self._add(UnicycleNode, scenario.base, base)
        others = asdict(scenario.disturbances) | asdict(scenario.light)
        others['rig'] = scenario.kind_of('camera')
        self.camera = self._add(CameraNode, scenario.camera, others)

    def add(self, node: Node) -> None:
        """Let ``node``, made in ``context``, take part."""
        self.nodes.append(node)
        self.executor.add_node(node)

    def record(self, folder: Path, *, exclude: Sequence[str] = ()) -> None:
        """Record every topic but those like ``exclude``; time waits for the disk."""
        # Only here: without a bag the libraries that write one are not needed.
        from visual_servo_epipolar.nodes.recorder_node import RecorderNode

        topics = {item.topic_name for node in self.nodes for item in node.publishers}
        values = {
            'bag': str(folder),
            'topics': tuple(sorted(topics - {'/parameter_events'})),
            'exclude': tuple(exclude),
            'report': False,
        }
        self.recorder = self._add(RecorderNode, RecordSettings(when_full='wait'), values)

    def run(self, done: Callable[[], bool]) -> None:
        """Begin the run, and spin until ``done``; raises LockstepError where nodes stand still."""
        self._spin_until(self._is_connected, 'every node to find its peers and the photograph')
        self.unicycle.begin()
        self._spin_until(lambda: self.unicycle.steps > 0 or done(), 'the first step')
        self._spin_until(done, 'the run to end')
        if self.recorder is not None:
            self._finish(self.recorder)

    def _finish(self, recorder: 'RecorderNode') -> None:
        """Let the last step run out, and complete the bag."""
        # The command of the last step is on its way, its successor is not: without an image the
        # chain ends where it does each time.
        self.executor.remove_node(self.camera)
        quiet, received = 0, recorder.received
        while quiet < QUIET_SPINS:
            self._turn()
            quiet = quiet + 1 if recorder.received == received else 0
            received = recorder.received
        status = recorder.stop()
        if status.error:
            raise LockstepError(status.error)

    def __exit__(self, *_: object) -> None:
        for node in self.nodes:
            node.destroy_node()
        self.executor.shutdown()
        self._around.close()

    def _add(self, kind: type[Any], settings: Settings, extra: Mapping[str, Any]) -> Any:
        values = {'use_sim_time': True, **asdict(settings), **extra}
        node = new_node(kind, self.context, values)
        self.add(node)
        return node

    def _is_connected(self) -> bool:
        """Return whether publishers and subscribers are matched, and the photograph is there."""
        subscribers = Counter(
            item.topic_name for node in self.nodes for item in node.subscriptions
        )
        return all(getattr(node, 'ready', True) for node in self.nodes) and all(
            item.get_subscription_count() >= subscribers[item.topic_name]
            for node in self.nodes
            for item in node.publishers
        )

    def _turn(self) -> None:
        """Hand out the messages that have arrived; wait in the executor if there are none."""
        self._turns += 1
        if self._turns % TURNS_A_LOOK == 0:
            self._look()
        # Of two messages of one topic a recorder must have heard both before time goes on.
        while self.recorder is not None and self._hand_out([self.recorder]):
            pass
        if not self._hand_out(self._listening()):
            self.executor.spin_once(timeout_sec=SPIN_S)

    def _look(self) -> None:
        """Let the executor serve timers and services, while all but the camera have heard all."""
        others = [node for node in self._listening() if node is not self.camera]
        while self._hand_out(others):
            pass
        # No more: a step of the base must not come before what recorders have yet to hear.
        for _ in range(LOOK_SPINS):
            self.executor.spin_once(timeout_sec=0.0)

    def _listening(self) -> list[Node]:
        """Return the nodes that take part, recorders first: they must hear all in time."""
        present = self.executor.get_nodes()
        return [node for node in reversed(self.nodes) if node in present]

    def _hand_out(self, nodes: Sequence[Node]) -> bool:
        """Call ``nodes`` back for one message a topic, and return whether there was any."""
        subscriptions = [item for node in nodes for item in node.subscriptions]
        return any([hand_out(item) for item in subscriptions])  # by each of them, not the first

    def _spin_until(self, condition: Callable[[], bool], waited_for: str) -> None:
        last_progress_s, last_steps = time.monotonic(), -1
        while not condition():
            self._turn()
            steps = self.unicycle.steps
            if steps != last_steps:
                last_progress_s, last_steps = time.monotonic(), steps
            if time.monotonic() - last_progress_s > STALL_S:
                raise LockstepError(
                    f'the nodes stood still for {STALL_S:g} s after {steps} steps, waiting for '
                    f'{waited_for}; look for errors above'
                )


DEPTH = 20
UNFINISHED = 100  # stamps whose other messages may still come; older ones are forgotten

Watch = Callable[[Sample, Pixels | None, Features | None], None]


class ObserverNode(Node):
    """Hands each step to the ``monitor`` and ``watch``, with image and tracks for a video."""

    def __init__(
        self, monitor: RunMonitor, watch: Watch, *, with_images: bool, **options: Any
    ) -> None:
        super().__init__('observer_node', **options)
        self._monitor, self._watch = monitor, watch
        self._pending: dict[int, dict[str, Any]] = {}  # messages of a stamp, until all are there
        kinds: dict[str, Any] = {
            'ground_truth': Odometry,
            'epipoles': JointState,
            '/diagnostics': DiagnosticArray,
        }
        if with_images:
            kinds |= {'image_raw': Image, 'tracks': PointCloud2}
        self._topics = set(kinds)
        for topic, kind in kinds.items():
            self.create_subscription(kind, topic, self._listener(topic), QoSProfile(depth=DEPTH))

    def _listener(self, topic: str) -> Callable[[Any], None]:
        def listen(message: Any) -> None:
            stamp_ns = read.stamp_ns(message.header)
            if topic == '/diagnostics' and not (
                message.status and read.is_of_step(read.diagnosis(message))
            ):
                return  # other nodes publish here, too
            parts = self._pending.setdefault(stamp_ns, {})
            if len(self._pending) > UNFINISHED:
                del self._pending[next(iter(self._pending))]
            parts[topic] = message
            if self._topics <= parts.keys():
                self._complete(stamp_ns, self._pending.pop(stamp_ns))

        return listen

    def _complete(self, stamp_ns: int, parts: dict[str, Any]) -> None:
        if self._monitor.done:
            return
        diagnosis = read.diagnosis(parts['/diagnostics'])
        telemetry = read.telemetry(parts['epipoles'])
        pose = read.pose(parts['ground_truth'])
        step = sample(stamp_ns, pose, phase_named(unarmed(diagnosis['phase'])), telemetry)
        self._monitor.add(step, reason=diagnosis['reason'], attempts=int(telemetry['attempt']))
        image = read.gray(parts['image_raw']) if 'image_raw' in parts else None
        features = read.features(parts['tracks']) if 'tracks' in parts else None
        self._watch(step, image, features)
