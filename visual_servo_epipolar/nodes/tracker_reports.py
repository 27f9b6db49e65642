"""Reports of the tracker: photograph, overlay, diagnostics; settings, events."""

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import Image

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.messages.tracking import TrackingResult
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.reports import ReplayReports
from visual_servo_epipolar.nodes.steady import PATIENCE_S, SILENT_S, STEADY, Stopwatch
from visual_servo_epipolar.nodes.watching import IDLE_PERIOD_S
from visual_servo_epipolar.report.images.overlay import draw_overlay


class TrackerReports(ReplayReports):
    """Reports of the tracker ``node``: all that it publishes but tracks."""

    def __init__(self, node: Node) -> None:
        super().__init__(node)
        self._complained, self._photograph = False, ''  # of the last tracks
        self.expect_images()
        node.create_timer(IDLE_PERIOD_S, self._look, clock=STEADY)
        self._overlay_pub = self._publisher(Image, 'overlay/image_raw', qos.STREAM)
        self._desired_pub = self._publisher(Image, '~/desired/image_raw', qos.LATCHED)

    def desired(self, photograph: Pixels, stamp_ns: int | None) -> None:
        """Publish the photograph."""
        self._desired_pub.publish(write.image(photograph, 'mono8', stamp_ns or 0, ''))

    def overlay(self, image: Pixels | None, features: Features, stamp_ns: int, frame: str) -> None:
        """Draw the tracks into their image, where somebody looks."""
        if image is not None and self._overlay_pub.get_subscription_count():
            overlay = draw_overlay(image, features.current, features.desired)
            self._overlay_pub.publish(write.image(overlay, 'bgr8', stamp_ns, frame))

    def expect_images(self, words: str = 'no image has come yet') -> None:
        """Count anew how long no image is tracked, and say by these ``words`` which is missing."""
        self._missing, self._since = words, Stopwatch()

    def miss(self, words: str) -> None:
        """Say by these ``words`` from now on why no image is tracked."""
        self._missing = words

    def _look(self) -> None:
        """
        Publish that no image is tracked, and since when, as long as that lasts.

        Where time is simulated images may wait: it is published as late as it is logged.
        """
        age_s = self._since.seconds
        simulated = self._node.get_parameter('use_sim_time').value
        if age_s < (PATIENCE_S if simulated else SILENT_S):
            return
        reason = f'{self._missing}, for {age_s:.1f} s; nothing is tracked'
        if age_s >= PATIENCE_S:
            topic = self._node.resolve_topic_name('image_raw')
            count = f'publishers on {topic}: {self._node.count_publishers(topic)}'
            log = self._node.get_logger()
            log.warning(f'{reason} ({count})', throttle_duration_sec=30.0)
        stamp_ns = int(self._clock.now().nanoseconds)
        values: dict[str, object] = {'features': 0, 'image_age_s': round(age_s, 3)}
        self._publish_status(reason, values, stamp_ns)
        self._complained = True

    def diagnose(self, tracking: TrackingResult, stamp_ns: int, photograph: str = '') -> None:
        """
        Publish what is wrong with the tracks, as long as that lasts, and that it is over.

        And which ``photograph`` of several is found, when it is another one.
        """
        self.expect_images('the camera is silent')
        is_another = photograph not in ('', self._photograph)
        if is_another:
            self._photograph = photograph
            self._node.get_logger().info(f'{photograph} fits the light best, and is tracked')
        if tracking.warning or self._complained or is_another:
            values: dict[str, object] = {'features': len(tracking.features)}
            values |= {'photograph': photograph} if photograph else {}
            self._publish_status(tracking.warning, values, stamp_ns)
        self._complained = bool(tracking.warning)

    def _publish_status(self, reason: str, values: dict[str, object], stamp_ns: int) -> None:
        """Publish the ``reason`` why the photograph is not found, '' if it is, as a status."""
        status = write.diagnostics(
            self._name,
            level=DiagnosticStatus.WARN if reason else DiagnosticStatus.OK,
            summary=reason or f'{values.get("photograph", "the photograph")} is found',
            values={**values, 'untracked_because': reason},
            stamp_ns=stamp_ns,
        )
        self._diagnose(status)
