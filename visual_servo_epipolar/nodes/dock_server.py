"""Docking over ROS: the action server, the servo as its client, commands turned round."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.task import Future
from sensor_msgs.msg import BatteryState
from std_srvs.srv import Trigger

from visual_servo_epipolar.core.docking import task as tasks
from visual_servo_epipolar.core.docking.settings import DockTaskSettings
from visual_servo_epipolar.core.docking.task import Outcome, ServoOrder, Task
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.laws.phase import ARMED
from visual_servo_epipolar.core.laws.registry import phase_named
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.messages import docking, read, write
from visual_servo_epipolar.messages.docking import DockRobotWire
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.lifecycle.gates import remedy
from visual_servo_epipolar.nodes.lifecycle.managed_node import ManagedNode
from visual_servo_epipolar.nodes.servoing.rivals import publishers, TOPIC
from visual_servo_epipolar.nodes.startup.settings import DockNodeSettings

ACTION = 'dock_robot'
PERIOD_S = 0.1  # of feedback, and of looking at the clock
DEACTIVATED = 'the node was deactivated before it had docked'
SERVO = 'servo_node'
REPORTS = QoSProfile(depth=50)  # a phase may last one image, and others report there as well
REVERSED = 'cmd_vel_reversed'


class DockServer:
    """
    Serves ``dock_robot`` for ``node`` over a ``wire``; time is that of the steady clock.

    A goal that comes while another is under way supersedes it: the first one is aborted. The
    servo is stopped at every end but that at the dock. Goals are refused while the node is not
    active, in every state: so the server is made once, not each time the node is configured.
    ``refusal`` returns why the robot cannot dock, or ''.
    """

    def __init__(
        self,
        node: ManagedNode,
        wire: DockRobotWire,
        settings: DockTaskSettings,
        refusal: Callable[[], str],
    ) -> None:
        self.settings, self._refusal = settings, refusal
        self._node, self._wire = node, wire
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._goal: Any = None
        self._task: Task | None = None
        self._over = Future()
        # Not made by configure: the answer to a start that comes after a cleanup counts as well,
        # and a servo that answers a client that is gone waits in vain.
        self._clients = {
            order: node.create_client(Trigger, f'{SERVO}/{order.value}') for order in ServoOrder
        }
        self._server = ActionServer(
            node,
            wire.kind,
            ACTION,
            execute_callback=self._execute,
            goal_callback=self._accept,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
        )

    def configure(self) -> None:
        """Listen to servo and battery, and look at the clock."""
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._hear, REPORTS)
        if self.settings.wait_for_charge:
            self._node.create_subscription(
                BatteryState, 'battery_state', self._on_battery, qos.STREAM
            )
        self._node.create_timer(PERIOD_S, self._on_tick, clock=self._steady)

    def give_up(self, why: str) -> None:
        """Abort a goal under way, and stop the servo that drives for it."""
        if self._task is not None and self._task.outcome is None:
            self._follow(tasks.abandon(self._task, why))

    def destroy(self) -> None:
        """Take the server from the node."""
        self._server.destroy()

    def _accept(self, goal: Any) -> GoalResponse:
        if self._node.is_active:
            return GoalResponse.ACCEPT
        self._node.get_logger().warning(f'dock_robot refused: {remedy(self._node)}')
        return GoalResponse.REJECT

    async def _execute(self, goal: Any) -> Any:
        if self._task is not None and self._task.outcome is None:
            self._end(Outcome(message='superseded by another goal'))
        over = self._over = Future()
        self._goal, self._task = goal, None
        request = self._wire.request(goal.request)
        self._node.get_logger().info(f'dock_robot: {request}')
        task = tasks.accept_request(request, self._now(), self.settings)
        # Not active any more: the goal was accepted just before.
        refusal = self._refusal() if self._node.is_active else DEACTIVATED
        if refusal:
            task = replace(tasks.abandon(task, refusal), orders=())
        self._follow(task)
        task, outcome = await over  # one thread is enough: nothing blocks while it waits
        if outcome.canceled and goal.is_cancel_requested:
            goal.canceled()
        elif outcome.success:
            goal.succeed()
        else:
            goal.abort()
        return self._wire.result(task, outcome)

    def _advance(self, event: Callable[..., Task], *what: Any) -> None:
        """Follow what an event makes of the task, where there is one."""
        if self._task is not None:
            self._follow(event(self._task, *what))

    def _hear(self, message: DiagnosticArray) -> None:
        """Take in phase and reason of the servo, or that it drives as soon as it can."""
        if not message.status or message.status[0].name != servo_name(self._node):
            return
        report = read.diagnosis(message)
        if report.get('phase') == ARMED:
            self._advance(tasks.on_armed, self._now())
            return
        try:
            phase = phase_named(report.get('phase', ''))
        except ValueError:
            return  # of another program
        reason = report.get('reason', '')
        self._advance(tasks.on_phase, phase, reason, self._now(), self.settings)

    def _order(self, order: ServoOrder) -> None:
        """Call the service of an ``order``, in any state of the node; follow its answer."""
        client = self._clients[order]
        if client.service_is_ready():
            future = client.call_async(Trigger.Request())
            future.add_done_callback(lambda answer: self._on_answer(order, answer.result()))
            return
        name = self._node.resolve_service_name(client.srv_name)
        refusal = f'service {name} is not available; run the servo, or remap the service'
        self._advance(tasks.on_answer, order, refusal, self._now())

    def _on_answer(self, order: ServoOrder, response: Any) -> None:
        refusal = '' if response.success else f'{order.value}: {response.message}'
        self._advance(tasks.on_answer, order, refusal, self._now())

    def _on_battery(self, message: BatteryState) -> None:
        self._advance(tasks.on_battery, docking.current(message), self.settings)

    def _on_tick(self) -> None:
        task = self._task
        if task is None or task.outcome is not None:
            return
        if self._goal.is_cancel_requested:
            self._follow(tasks.cancel(task))
            return
        self._follow(tasks.on_tick(task, self._now(), self.settings))
        self._publish()

    def _follow(self, task: Task) -> None:
        """Take over a task: carry out its orders, publish its state, end it if it has ended."""
        before, self._task = self._task, task
        ended = before is None or before.outcome is None
        if before is not None and task.retries > before.retries:
            self._node.get_logger().info(f'dock_robot: attempt {task.retries + 1}')
        if task.outcome is not None and ended:
            self._end(task.outcome)
        elif before is None or task.state is not before.state:
            self._publish()
        for order in task.orders:
            self._order(order)

    def _end(self, outcome: Outcome) -> None:
        error = f' ({outcome.error.name})' if outcome.error else ''
        self._node.get_logger().info(f'dock_robot: {outcome.message}{error}')
        if not self._over.done():
            self._over.set_result((self._task, outcome))

    def _publish(self) -> None:
        task = self._task
        if task is not None and task.outcome is None and self._goal.is_active:
            seconds = tasks.elapsed(task, self._now())
            self._goal.publish_feedback(self._wire.feedback(task, seconds))

    def _now(self) -> float:
        return float(self._steady.now().nanoseconds) / NANOSECONDS


def servo_name(node: Node) -> str:
    """Return the full name of the servo: the node whose service starts it."""
    return str(node.resolve_service_name(f'{SERVO}/start')).rpartition('/')[0]


class Reversal:
    """
    Turns each command on ``cmd_vel_reversed`` round: what is ahead of the servo is behind.

    A base that drives backwards is one that looks back and drives forwards; turns stay. One
    command for one: where the servo falls silent, so does this, and the base stops by itself. At
    one that is broken the base stands, and ``warn`` is called.
    """

    def __init__(
        self, node: Node, warn: Callable[[str], None], settings: DockNodeSettings
    ) -> None:
        self._node, self._warn, self._frame = node, warn, ''
        self._stamped = settings.enable_stamped_cmd_vel
        kind = write.twist_type(stamped=self._stamped)
        self._pub = node.create_publisher(kind, TOPIC, qos.COMMAND)
        node.create_subscription(kind, REVERSED, self._turn_round, qos.COMMAND)

    def bypassed(self) -> str:
        """Return that the servo itself commands the base, away from the dock; or ''."""
        servo = servo_name(self._node)
        if servo not in publishers(self._node):
            return ''
        topic = self._node.resolve_topic_name(TOPIC)
        return (
            f'{servo} commands {topic} itself, and the camera looks back: the robot would drive '
            f'away from the dock; start it with -r cmd_vel:={REVERSED}'
        )

    def stop(self) -> None:
        """Stop the base, and wait until the command is acknowledged."""
        self._publish(STANDSTILL, int(self._node.get_clock().now().nanoseconds))
        self._pub.wait_for_all_acked(qos.ACKNOWLEDGEMENT)

    def _turn_round(self, message: Any) -> None:
        now_ns = int(self._node.get_clock().now().nanoseconds)
        stamp_ns = now_ns
        if self._stamped:
            stamp_ns, self._frame = read.stamp_ns(message.header), message.header.frame_id
        try:
            ahead = read.twist(message)
        except ValueError as error:
            self._warn(str(error))
            ahead = STANDSTILL
        self._publish(Twist(-ahead.linear, ahead.angular), stamp_ns)

    def _publish(self, twist: Twist, stamp_ns: int) -> None:
        self._pub.publish(write.command(twist, stamp_ns, self._frame, stamped=self._stamped))
