"""A simulated base: velocity commands in, odometry and ground truth out."""

import sys
from typing import Any

from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
import numpy as np
from rosgraph_msgs.msg import Clock as ClockMessage

from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL
from visual_servo_epipolar.core.rigs.rig import Command
from visual_servo_epipolar.core.settings import selected
from visual_servo_epipolar.core.stamps import period_ns
from visual_servo_epipolar.messages import read, transforms, write
from visual_servo_epipolar.nodes import parameters, qos, steady
from visual_servo_epipolar.nodes.frames import TransformBroadcaster
from visual_servo_epipolar.nodes.managed import ParameterNode, serve
from visual_servo_epipolar.nodes.reports import Complaints
from visual_servo_epipolar.nodes.startup.run import spin
from visual_servo_epipolar.nodes.startup.settings import UnicycleSettings
from visual_servo_epipolar.simulation.bases import (
    AckermannSettings,
    DeadReckoning,
    PioneerSettings,
    SIMULATED_BASES,
    world_to_odometry,
)


class UnicycleNode(ParameterNode):
    """Hosts a simulated base; in lockstep each command is a frame, and /clock is its own."""

    def __init__(self, **options: Any) -> None:
        super().__init__('unicycle_node', **options)
        self._warn = Complaints(self)
        self._settings = parameters.declare(self, UnicycleSettings)
        self._base_settings = parameters.declare(self, AckermannSettings)
        parameters.finish(self, options)
        parameters.watch(self, '_settings')  # the start counts from the next reset
        parameters.watch(self, '_base_settings', self._use)
        self.steps = 0
        self._stand_at_the_start()
        self._truth_pub = self.create_publisher(Odometry, 'ground_truth', qos.STREAM)
        self._odom_pub = self.create_publisher(Odometry, 'odom', qos.STREAM)
        self._applied_pub = self.create_publisher(TwistStamped, 'cmd_vel_applied', qos.STREAM)
        self._tf = TransformBroadcaster(self)
        kind = write.twist_type(stamped=self._settings.enable_stamped_cmd_vel)
        self.create_subscription(kind, 'cmd_vel', self._on_command, qos.COMMAND)
        serve(self, '~/reset', self._on_reset, done='reset, {}')
        if self._settings.lockstep:
            self._clock_pub = self.create_publisher(ClockMessage, '/clock', qos.CLOCK)
            if self._settings.begin:
                self._waiting = self.create_timer(
                    steady.LOOK_PERIOD_S, self._on_waiting, clock=steady.STEADY
                )
        else:
            self.create_timer(1.0 / self._settings.rate, self._on_tick, clock=steady.STEADY)

    def begin(self) -> None:
        """Publish where the robot stands: in lockstep this sets the chain of nodes going."""
        self._publish()

    def _on_waiting(self) -> None:
        if self._truth_pub.get_subscription_count():
            self._waiting.cancel()
            self.begin()

    def _use(self) -> None:
        self._base.settings = self._of_model()

    def _of_model(self) -> PioneerSettings:
        return selected(SIMULATED_BASES[self._settings.model], self._base_settings)

    def _stand_at_the_start(self) -> None:
        start = Pose.from_start(*self._settings.start)
        now_ns = 0 if self._settings.lockstep else steady.now_ns()
        self._base = self._of_model().base(start, seed=self._settings.seed, now_ns=now_ns)
        self._reckoning = DeadReckoning(self._base.odometry, now_ns)

    def _on_command(self, message: Any) -> None:
        try:
            self._check_age(message)
            self._base.command(Command(read.twist(message)))
        except ValueError as error:
            self._base.halt()
            self._warn(str(error))
        if self._settings.lockstep:
            self.steps += 1
            self._base.advance(self._base.now_ns + period_ns(self._settings.frame_rate))
            self._publish()

    def _check_age(self, message: Any) -> None:
        """Refuse a stamped command that is older than a command may be."""
        timeout = self._base_settings.command_timeout
        if self._settings.lockstep or timeout == 0.0 or not hasattr(message, 'header'):
            return
        age = (self.get_clock().now().nanoseconds - read.stamp_ns(message.header)) / 1e9
        if age > timeout:
            raise ValueError(
                f'a command must be younger than {timeout:g} s, got one of {age:.2f} s; '
                'synchronise the clocks of sender and base'
            )

    def _on_tick(self) -> None:
        moving = self._base.twist != STANDSTILL
        self._base.advance(steady.now_ns())
        if moving and self._base.timed_out:
            timeout = self._base_settings.command_timeout
            self._warn(f'no cmd_vel for {timeout:g} s, the base stops')
        self._publish()

    def _publish(self) -> None:
        lockstep, names, base = self._settings.lockstep, self._settings, self._base
        stamp_ns = self._base.now_ns if lockstep else self.get_clock().now().nanoseconds
        if lockstep:
            self._clock_pub.publish(write.clock(stamp_ns))
        self._reckoning = self._reckoning.advanced(base.odometry, base.now_ns)
        self._applied_pub.publish(write.twist_stamped(base.twist, stamp_ns, names.base_frame))
        self._odom_pub.publish(self._odometry(stamp_ns))
        self._send_transforms(stamp_ns)
        truth = write.odometry(
            base.pose,
            base.twist,
            stamp_ns,
            names.world_frame,
            names.base_frame,
            pitch=base.nodding,
        )
        self._truth_pub.publish(truth)

    def _send_transforms(self, stamp_ns: int) -> None:
        """Send what a localiser would: the tree is right about base_link in the world."""
        names, wheels = self._settings, self._reckoning.pose
        origin = world_to_odometry(self._base.pose, wheels)
        self._tf.send(
            [
                transforms.on_the_floor(names.world_frame, names.odom_frame, origin, stamp_ns),
                transforms.on_the_floor(names.odom_frame, names.base_frame, wheels, stamp_ns),
            ]
        )

    def _odometry(self, stamp_ns: int) -> Odometry:
        """Return what the wheels say: drifting, and aware of it."""
        reckoning, names = self._reckoning, self._settings
        place, speeds = reckoning.variances(self._base_settings.odometry_noise)
        return write.odometry(
            reckoning.pose,
            reckoning.twist,
            stamp_ns,
            names.odom_frame,
            names.base_frame,
            pose_covariance=np.diag(place),
            twist_covariance=np.diag(speeds),
        )

    def _on_reset(self) -> str:
        self._stand_at_the_start()
        self._publish()
        return f'at the start {list(self._settings.start)}'


if __name__ == '__main__':
    sys.exit(spin(UnicycleNode))
