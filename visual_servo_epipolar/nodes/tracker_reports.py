"""Reports of the tracker: photograph, overlay, diagnostics, lateness; settings, events."""

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from sensor_msgs.msg import Image

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.stamps import OTHER_CLOCK_S, seconds_between
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.messages.tracking import TrackingResult
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.reports import ReplayReports
from visual_servo_epipolar.nodes.steady import SILENT_S, STEADY, Stopwatch
from visual_servo_epipolar.report.images.overlay import draw_overlay

LOOK_PERIOD_S, REPEAT_S = 1.0, 30.0
# Time without an image until that is logged, and where time is simulated, published: it may wait.
SIMULATED_SILENT_S = 5.0


class TrackerReports(ReplayReports):
    """Reports of the tracker ``node``: all that it publishes but tracks."""

    def __init__(self, node: Node) -> None:
        super().__init__(node)
        self._complained, self._photograph = False, ''  # of the last tracks
        self.expect_images()
        node.create_timer(LOOK_PERIOD_S, self._look, clock=STEADY)
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
        """Publish that no image is tracked, and since when, as long as that lasts."""
        age_s = self._since.seconds
        simulated = self._node.get_parameter('use_sim_time').value
        if age_s < (SIMULATED_SILENT_S if simulated else SILENT_S):
            return
        reason = f'{self._missing}, for {age_s:.1f} s; nothing is tracked'
        if age_s >= SIMULATED_SILENT_S:
            topic = self._node.resolve_topic_name('image_raw')
            count = f'publishers on {topic}: {self._node.count_publishers(topic)}'
            log = self._node.get_logger()
            log.warning(f'{reason} ({count})', throttle_duration_sec=REPEAT_S)
        stamp_ns = int(self._clock.now().nanoseconds)
        self._publish_status(reason, {'features': 0}, stamp_ns, age_s)
        self._complained = True

    def diagnose(
        self,
        tracking: TrackingResult,
        behind: str,
        stamp_ns: int,
        age_s: float | None,
        photograph: str = '',
    ) -> None:
        """
        Publish what is wrong with the tracks, as long as that lasts, and that it is over.

        And which ``photograph`` of several is found, when it is another one.
        """
        reason, features = tracking.warning, len(tracking.features)
        self.expect_images('the camera is silent')
        complains = bool(reason or behind)
        is_another = photograph not in ('', self._photograph)
        if is_another:
            self._photograph = photograph
            self._node.get_logger().info(f'{photograph} fits the light best, and is tracked')
        if complains or self._complained or is_another:
            values: dict[str, object] = {'features': features}
            values |= {'photograph': photograph} if photograph else {}
            self._publish_status(reason, values, stamp_ns, age_s, behind)
        self._complained = complains

    def _publish_status(
        self,
        reason: str,
        values: dict[str, object],
        stamp_ns: int,
        age_s: float | None,
        behind: str = '',
    ) -> None:
        """
        Publish the ``reason`` why the photograph is not found, '' if it is, as a status.

        With the age ``age_s`` [s] of the image whose tracks were published, where it is known, and
        in which words the tracker falls ``behind``, '' if it does not.
        """
        values['untracked_because'] = reason
        if age_s is not None:
            values['image_age_s'] = round(age_s, 3)
        found = f'{values.get("photograph", "the photograph")} is found'
        status = write.diagnostics(
            self._name,
            level=DiagnosticStatus.WARN if reason or behind else DiagnosticStatus.OK,
            summary='; '.join(filter(None, (reason, behind))) or found,
            values=values,
            stamp_ns=stamp_ns,
        )
        self._diagnose(status)


BEHIND_S = 0.5  # age of an image at which its tracks come late
BEHIND_IMAGES = 3  # so many one after the other are no single match of the whole image


class Lateness:
    """Lateness of the tracks of ``node``, by the age of each image."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._late = 0  # images in a row whose tracks came late

    def age_s(self, stamp_ns: int) -> float | None:
        """Return the age of an image [s]; None in simulated time or where another clock stamps."""
        if self._node.get_parameter('use_sim_time').value:
            return None
        age_s = seconds_between(stamp_ns, self._node.get_clock().now().nanoseconds)
        return age_s if abs(age_s) < OTHER_CLOCK_S else None

    def complaint(self, age_s: float | None) -> str:
        """Count an image of this age, and return that tracks come late, and what to do, or ''."""
        self._late = self._late + 1 if age_s is not None and age_s >= BEHIND_S else 0
        if age_s is None or self._late < BEHIND_IMAGES:
            return ''
        return (
            f'the tracker falls behind: the newest image was {age_s:.1f} s old when its tracks '
            'came; send smaller images or fewer, or lower max_features'
        )
