"""The recorder: what is published, into a bag; nothing is decoded, nothing waits for a disk."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_srvs.srv import Trigger

from visual_servo_epipolar.bags.recording.recorder import Recorder, Tally
from visual_servo_epipolar.bags.recording.settings import RecordSettings
from visual_servo_epipolar.bags.recording.writer import MB
from visual_servo_epipolar.bags.storage import Topic
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.settings import setting, Settings
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import parameters, qos
from visual_servo_epipolar.nodes.recording.discovery import Wish
from visual_servo_epipolar.nodes.recording.raw_subscriptions import Ears
from visual_servo_epipolar.nodes.run import spin

LOOK_PERIOD_S = 0.2
LOOKS_A_REPORT = 5  # one report a second
WARN_PERIOD_S = 5.0


@dataclass(frozen=True, kw_only=True)
class RecorderNodeSettings(Settings):
    """What is recorded, where to, and what becomes of the robot if that fails."""

    bag: str = setting(
        '', 'Folder of the bag; empty: rosbag2_ and the date, where it was started', read_only=True
    )
    topics: tuple[str, ...] = setting(
        ('*',), 'Topics to record: names, or patterns with * and ?', read_only=True
    )
    exclude: tuple[str, ...] = setting(
        ('*overlay/image_raw',), 'Topics not to record, likewise', read_only=True
    )
    autostart: bool = setting(True, 'Begin at once, not on ~/start', read_only=True)
    report: bool = setting(True, 'Publish /diagnostics once a second', read_only=True)
    on_error: str = setting(
        'continue',
        'When the disk fails or is full, the robot',
        choices=('continue', 'stop_servo'),
        read_only=True,
    )
    servo: str = setting('servo_node', 'Whose ~/stop is called by stop_servo', read_only=True)


class RecorderNode(Node):
    """
    Hosts a ``Recorder``; subscribes to every wanted topic as soon as somebody publishes it.

    Messages pass as the bytes that came in, stamped with the time of the node's clock.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__('recorder_node', **options)
        self._node_settings = parameters.declare(self, RecorderNodeSettings)
        self._settings = parameters.declare(self, RecordSettings)
        parameters.refuse_unknown(self)
        settings = self._node_settings
        wish = Wish(settings.topics, settings.exclude).resolved(self)
        self._ears = Ears(self, wish, self._begin_topic, self._take)
        self._recorder: Recorder | None = None
        self._error, self._bags, self._looks = '', 0, 0
        self.heard = 0  # messages
        self._diagnostics_pub = self.create_publisher(
            DiagnosticArray, '/diagnostics', qos.DIAGNOSTICS
        )
        self.create_service(Trigger, '~/start', self._on_start)
        self.create_service(Trigger, '~/stop', self._on_stop)
        self._servo_stop = self.create_client(Trigger, f'{settings.servo}/stop')
        if settings.autostart:
            self._begin_or_go()
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # in simulated time as well
        self.create_timer(LOOK_PERIOD_S, self._on_look, clock=steady)

    @property
    def recorded(self) -> frozenset[str]:
        """The topics that are being recorded, by their full names."""
        return self._ears.heard

    @property
    def ready(self) -> bool:
        """Whether all topics that were asked for by name are being recorded."""
        return self._ears.all_heard

    def tally(self) -> Tally:
        """Return how the recording stands."""
        return Tally() if self._recorder is None else self._recorder.tally()

    def stop(self) -> Tally:
        """Complete the bag; return what is in it."""
        self._ears.close()
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return Tally()
        tally = recorder.close()
        self.get_logger().info(f'{sum(tally.written.values())} messages in {recorder.folder}')
        return tally

    def destroy_node(self) -> None:
        """Complete the bag before the node goes."""
        self.stop()
        super().destroy_node()

    def _begin_or_go(self) -> None:
        try:
            self._begin()
        except InputError:
            self.destroy_node()  # half a node would keep its name
            raise

    def _begin(self) -> Path:
        """Begin a bag; raises InputError if it cannot be."""
        folder = self._new_folder()
        self._recorder = Recorder(folder, self._settings)
        self._bags += 1
        self._error = ''
        self.get_logger().info(f'recording to {folder}')
        self._ears.look()
        return folder

    def _begin_topic(self, topic: Topic) -> None:
        if self._recorder is not None:
            self._recorder.add(topic)

    def _take(self, topic: Topic, data: bytes) -> None:
        self.heard += 1
        if self._recorder is not None:
            self._recorder.put(topic, self.get_clock().now().nanoseconds, data)

    def _new_folder(self) -> Path:
        now_ns = Clock(clock_type=ClockType.SYSTEM_TIME).now().nanoseconds
        name = self._node_settings.bag
        if not name:
            name = f'rosbag2_{datetime.fromtimestamp(now_ns / 1e9):%Y_%m_%d-%H_%M_%S}'
        elif self._bags:
            name = f'{name}_{self._bags}'
        return Path(name).expanduser()

    def _on_look(self) -> None:
        tally = self.tally()
        if tally.error:
            self._fail(tally)
        elif self._recorder is not None:
            self._ears.look()
        self._looks += 1
        if self._looks % LOOKS_A_REPORT == 0:
            self._ears.check()
            self._report(tally)

    def _fail(self, tally: Tally) -> None:
        """Say that the bag has ended before its time, and stop the robot if that is wanted."""
        self._error = tally.error
        self.get_logger().error(tally.error)
        self.stop()
        self._report(tally)
        if self._node_settings.on_error == 'stop_servo':
            self._stop_robot()

    def _stop_robot(self) -> None:
        service = self.resolve_service_name(f'{self._node_settings.servo}/stop')
        if not self._servo_stop.service_is_ready():
            self.get_logger().error(f'the robot is not stopped: nobody serves {service}')
            return
        answer = self._servo_stop.call_async(Trigger.Request())
        answer.add_done_callback(
            lambda done: self.get_logger().warning(f'{service}: {done.result().message}')
        )

    def _report(self, tally: Tally) -> None:
        """Publish how it goes, and complain about what was dropped."""
        dropped, lost = sum(tally.dropped.values()), sum(self._ears.lost.values())
        if dropped and not tally.error:
            self.get_logger().warning(
                f'the disk does not keep up, {dropped} messages dropped so far: '
                f'{_counts(tally.dropped)}',
                throttle_duration_sec=WARN_PERIOD_S,
            )
        if not self._node_settings.report:
            return
        level, summary = DiagnosticStatus.OK, 'not recording'
        if self._error:
            level, summary = DiagnosticStatus.ERROR, self._error
        elif self._recorder is not None:
            level, summary = DiagnosticStatus.OK, f'recording to {self._recorder.folder}'
            if dropped or lost or self._ears.refused:
                level = DiagnosticStatus.WARN
        message = write.diagnostics(
            self.get_fully_qualified_name(),
            level=level,
            summary=summary,
            values={
                'recording': self._recorder is not None,
                'files': tally.files,
                'messages': sum(tally.written.values()),
                'waiting_mb': round(tally.waiting_bytes / MB, 1),
                'dropped': dropped,
                'dropped_of': _counts(tally.dropped),
                'lost_of': _counts(+self._ears.lost),
                'not_recorded': ' '.join(sorted(self._ears.refused)),
                'not_published': ' '.join(sorted(self._ears.missing)),
            },
            stamp_ns=self.get_clock().now().nanoseconds,
        )
        self._diagnostics_pub.publish(message)

    def _on_start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._recorder is not None:
            response.success = False
            response.message = f'recording to {self._recorder.folder} already; call ~/stop first'
            return response
        try:
            response.message = f'recording to {self._begin()}'
            response.success = True
        except InputError as error:
            response.success, response.message = False, str(error)
        return response

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._recorder is None:
            response.success, response.message = False, 'nothing is being recorded'
            return response
        folder, tally = self._recorder.folder, self.stop()
        response.success = not tally.error
        response.message = tally.error or f'{sum(tally.written.values())} messages in {folder}'
        return response


def _counts(counts: Mapping[str, int]) -> str:
    return ', '.join(f'{count} of {name}' for name, count in sorted(counts.items()))


def main() -> None:
    """Run the node."""
    sys.exit(spin(RecorderNode))


if __name__ == '__main__':
    main()
