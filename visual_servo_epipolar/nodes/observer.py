"""Observer: joins ground truth and the telemetry of the servo into the record of a run."""

from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import Image, JointState, PointCloud2

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.laws.phase import unarmed
from visual_servo_epipolar.core.laws.registry import phase_named
from visual_servo_epipolar.core.servo.run_log import Sample
from visual_servo_epipolar.core.servo.telemetry import sample
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.simulation.closed_loop import RunMonitor

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
