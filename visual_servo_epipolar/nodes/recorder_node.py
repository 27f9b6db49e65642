"""The recorder: published messages into a bag; none is decoded, none waits for the disk."""

from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.clock import Clock, ClockType

from visual_servo_epipolar.bags.recording.recorder import MB, Recorder, RecordingStatus, Topic
from visual_servo_epipolar.bags.recording.settings import RecordSettings
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import parameters, qos
from visual_servo_epipolar.nodes.managed import ManagedNode, serve
from visual_servo_epipolar.nodes.raw_subscriptions import RawSubscriptions, TopicSelection
from visual_servo_epipolar.nodes.startup.run import spin
from visual_servo_epipolar.nodes.startup.settings import RecorderNodeSettings
from visual_servo_epipolar.nodes.steady import PATIENCE_S, STEADY

DISCOVERY_PERIOD_S = 0.2


class RecorderNode(ManagedNode):
    """Hosts a ``Recorder``, begun and completed while active; messages pass as bytes."""

    with_info = True  # its subscriptions ask for the numbers of messages

    def __init__(self, **options: Any) -> None:
        super().__init__('recorder_node', **options)
        self._node_settings = parameters.declare(self, RecorderNodeSettings)
        self._settings = parameters.declare(self, RecordSettings)
        parameters.finish(self, options)
        settings = self._node_settings
        selection = TopicSelection(settings.topics, settings.exclude).resolved(self)
        self._raw_subscriptions = RawSubscriptions(
            self, selection, self._begin_topic, self._record
        )
        self._recorder: Recorder | None = None
        self._error, self._bags, self._discoveries = '', 0, 0
        self.received = 0  # messages
        serve(self, '~/start', self._on_start)
        serve(self, '~/stop', self._on_stop)
        self.autostart(settings)

    def configure(self) -> None:
        """Create what reports, and looks for topics."""
        self._error, self._discoveries = '', 0
        self._diagnostics_pub = self.create_publisher(
            DiagnosticArray, '/diagnostics', qos.DIAGNOSTICS
        )
        self.create_timer(DISCOVERY_PERIOD_S, self._on_discovery, clock=STEADY)

    def activate(self) -> None:
        """Begin a bag, if that is not left to ~/start."""
        if self._node_settings.autostart:
            self._begin()
        else:
            self.get_logger().info(f'waits for {self.get_fully_qualified_name()}/start')

    def deactivate(self) -> None:
        """Complete the bag, and report that."""
        self._report_end(self.stop())

    def cleanup(self) -> None:
        """Complete the bag of an activation that failed."""
        self.stop()

    @property
    def ready(self) -> bool:
        """Whether all topics that are selected by name are being recorded."""
        return not self._raw_subscriptions.missing

    def status(self) -> RecordingStatus:
        """Return the status of the recording."""
        return RecordingStatus() if self._recorder is None else self._recorder.status()

    def stop(self) -> RecordingStatus:
        """Complete the bag with all that has arrived; return its status."""
        if self._recorder is not None:
            self._raw_subscriptions.drain()
        self._raw_subscriptions.close()
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return RecordingStatus()
        status = recorder.close()
        self.get_logger().info(f'{sum(status.written.values())} messages in {recorder.folder}')
        return status

    def destroy_node(self) -> None:
        """Complete the bag before the node goes."""
        self.stop()
        super().destroy_node()

    def _begin(self) -> Path:
        """Begin a bag; raises InputError if it cannot be."""
        folder = self._new_folder()
        self._recorder = Recorder(folder, self._settings)
        self._bags += 1
        self._error = ''
        self.get_logger().info(f'recording to {folder}')
        self._raw_subscriptions.discover()
        return folder

    def _begin_topic(self, topic: Topic) -> None:
        if self._recorder is not None:
            self._recorder.add(topic)

    def _record(self, topic: Topic, data: bytes) -> None:
        self.received += 1
        if self._recorder is not None:
            self._recorder.put(topic, self.get_clock().now().nanoseconds, data)

    def _new_folder(self) -> Path:
        now_ns = Clock(clock_type=ClockType.SYSTEM_TIME).now().nanoseconds
        name = self._node_settings.bag
        if not name:
            name = f'rosbag2_{datetime.fromtimestamp(now_ns / 1e9):%Y_%m_%d-%H_%M_%S}'
        elif self._bags:
            name = f'{name}_{self._bags}'
        return Path(name)

    def _on_discovery(self) -> None:
        status = self.status()
        if status.error:
            self.stop()
            self._report_end(status)
        elif self._recorder is not None:
            self._raw_subscriptions.discover()
            self._miss_topics()
        self._discoveries += 1
        if self._discoveries % round(1.0 / DISCOVERY_PERIOD_S) == 0:  # once a second
            self._raw_subscriptions.refresh()
            self._report(status)

    def _miss_topics(self) -> None:
        """Say which topics are to be recorded by name, but not published."""
        missing = sorted(self._raw_subscriptions.missing)
        if missing and self._discoveries * DISCOVERY_PERIOD_S >= PATIENCE_S:
            self.get_logger().warning(
                f'waits for {", ".join(missing)} (0 publishers)',
                throttle_duration_sec=30.0,
            )

    def _report_end(self, status: RecordingStatus) -> None:
        """Report that the bag has ended, and why if that was early."""
        self._error = status.error
        if status.error:
            self.get_logger().error(status.error)
        self._report(status)

    def _report(self, status: RecordingStatus) -> None:
        """Publish diagnostics, and warn of dropped messages."""
        dropped = sum(status.dropped.values())
        if dropped and not status.error:
            self.get_logger().warning(
                f'the disk does not keep up, {dropped} messages dropped so far: '
                f'{_counts(status.dropped)}',
                throttle_duration_sec=5.0,
            )
        if not self._node_settings.report:
            return
        level, summary = self._summary(status)
        message = write.diagnostics(
            self.get_fully_qualified_name(),
            level=level,
            summary=summary,
            values={
                'recording': self._recorder is not None,
                'messages': sum(status.written.values()),
                'waiting_mb': round(status.waiting_bytes / MB, 1),
                'dropped': dropped,
                'dropped_of': _counts(status.dropped),
                'lost_of': _counts(+self._raw_subscriptions.lost),
                'not_recorded': ' '.join(sorted(self._raw_subscriptions.refused)),
                'not_published': ' '.join(sorted(self._raw_subscriptions.missing)),
            },
            stamp_ns=self.get_clock().now().nanoseconds,
        )
        self._diagnostics_pub.publish(message)

    def _summary(self, status: RecordingStatus) -> tuple[bytes, str]:
        """Return the level of the diagnostics, and a sentence for it."""
        if self._error:
            return DiagnosticStatus.ERROR, self._error
        if self._recorder is None:
            return DiagnosticStatus.OK, 'nothing is being recorded'
        raw, troubles = self._raw_subscriptions, []
        if status.dropped:
            troubles.append(f'the disk does not keep up, dropped: {_counts(status.dropped)}')
        if +raw.lost:
            troubles.append(f'lost on the way: {_counts(+raw.lost)}')
        troubles += [f'{name} is not recorded: {why}' for name, why in sorted(raw.refused.items())]
        level = DiagnosticStatus.WARN if troubles else DiagnosticStatus.OK
        return level, '; '.join([f'recording to {self._recorder.folder}', *troubles])

    def _on_start(self) -> str:
        if self._recorder is not None:
            folder = self._recorder.folder
            raise InputError(f'recording to {folder} already; call ~/stop first')
        return f'recording to {self._begin()}'

    def _on_stop(self) -> str:
        if self._recorder is None:
            raise InputError('nothing is being recorded')
        folder, status = self._recorder.folder, self.stop()
        if status.error:
            raise InputError(status.error)
        return f'{sum(status.written.values())} messages in {folder}'


def _counts(counts: Mapping[str, int]) -> str:
    return ', '.join(f'{count} of {name}' for name, count in sorted(counts.items()))


if __name__ == '__main__':
    sys.exit(spin(RecorderNode))
