"""Admission: which tracks the servo uses, why it refuses others, and what a start lacks."""

from collections.abc import Callable

from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.servo.admission import Arrival
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.supervisor import too_few_features
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.nodes.servoing.rivals import CommandConflicts
from visual_servo_epipolar.nodes.servoing.run import QUIET_S, Run
from visual_servo_epipolar.nodes.servoing.switches import Enable
from visual_servo_epipolar.nodes.startup.settings import ServoNodeSettings


class Admission:
    """
    Admission of tracks to the ``run`` of the servo ``node``.

    ``settings`` returns those in force, ``enable`` is the heartbeat. Where time itself
    waits for the servo (no watchdog), all tracks are timely.
    """

    def __init__(
        self,
        node: Node,
        settings: Callable[[], ServoNodeSettings],
        run: Run,
        rivals: CommandConflicts,
        enable: Enable,
    ) -> None:
        self._node, self._settings, self._run = node, settings, run
        self.rivals, self._enable = rivals, enable
        self.goal: int | None = None  # the photograph, by its number, once it was in view
        self._has_photograph: bool | None = None  # by the last tracks, if any came
        self._tracks = PointCloud2()  # these

    def hear(self, message: PointCloud2) -> str:
        """Take note of tracks; return that they are not of the photograph of the order, or ''."""
        goal, self._has_photograph = read.goal(message), read.has_photograph(message)
        self._tracks = message
        self._run.freshness.hear()
        self.goal = None if not self._has_photograph else self.goal if goal is None else goal
        if not self._run.is_armed:
            return ''
        return self._run.arming.contradicted(goal, has_photograph=self._has_photograph)

    def missing(self, settings: ServoSettings) -> str:
        """Return what a start lacks that does not come by itself: images, photograph; or ''."""
        if not self._settings().watchdog:
            return ''
        quiet = self._run.freshness.quiet
        if self._has_photograph is None:
            return (
                'no tracks have come yet; start camera and tracker, and read in the log of the '
                'tracker what it waits for'
            )
        if quiet > max(QUIET_S, settings.stale_timeout):
            return f'no tracks have come for {quiet:.0f} s; are camera and tracker running?'
        if not self._has_photograph:
            return (
                'the tracker has no photograph; drive the robot to the goal, and call its '
                '~/capture_desired, or name a desired_image'
            )
        return ''

    def unseen(self, settings: ServoSettings) -> str:
        """Return that the last tracks show too little of the photograph to begin with; or ''."""
        count = int(self._tracks.width) * int(self._tracks.height)
        if count >= settings.min_features:  # of which some may not be of the photograph
            try:
                count = len(read.features(self._tracks))
            except ValueError as error:
                return str(error)
        return too_few_features(count, settings) if count < settings.min_features else ''

    def refusal(self, message: PointCloud2, still_timeout: float) -> str:
        """Return why no step is taken by these tracks, or ''; see ``Session.admit``."""
        if not self._settings().watchdog:
            return ''
        run = self._run
        arrival = Arrival(
            read.stamp_ns(message.header),
            self._node.get_clock().now().nanoseconds,
            run.freshness.clock_stands_still(),
            read.repeats(message),
            read.back(message),
        )
        run.session, trouble = run.session.admit(
            arrival,
            max_latency=self._settings().max_latency,
            still_timeout=still_timeout,
            withheld=self.withheld(),
        )
        return trouble

    def withheld(self) -> str:
        """Return that the robot may not drive, or that it waits for a new start; or ''."""
        trouble = self._enable.withheld() if self._settings().watchdog else ''
        waits = 'resume is manual: after a hold the robot stands until ~/start is called'
        return trouble or (waits if self.waits_for_start else '')

    @property
    def waits_for_start(self) -> bool:
        """Whether a hold is over only with the next order to start."""
        return self._run.state.phase is Phase.HOLDING and self._settings().resume == 'manual'

    def contested(self) -> str:
        """Return that another servo commands the same base, so that no run may begin; or ''."""
        return self.rivals.refusal() if self._settings().watchdog else ''
