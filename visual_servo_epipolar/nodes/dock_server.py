"""The action dock_robot over ROS: its server, and the servo as its client."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.clock import Clock, ClockType
from rclpy.qos import QoSProfile
from rclpy.task import Future
from std_srvs.srv import Trigger

from visual_servo_epipolar.core.docking import task as tasks
from visual_servo_epipolar.core.docking.task import DockTaskSettings, Error, ServoOrder, Task
from visual_servo_epipolar.core.laws.phase import ARMED
from visual_servo_epipolar.core.laws.registry import phase_named
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.messages.docking import DockRobotWire
from visual_servo_epipolar.nodes.lifecycle.gates import remedy
from visual_servo_epipolar.nodes.lifecycle.managed_node import ManagedNode

PERIOD_S = 0.1  # of feedback, and of looking at the clock
DEACTIVATED = 'the node was deactivated before it had docked'
SERVO = 'servo_node'
REPORTS = QoSProfile(depth=50)  # a phase may last one image, and others report there as well


class DockServer:
    """
    Serves ``dock_robot`` for ``node`` over a ``wire``; time is that of the steady clock.

    A goal that comes while another is under way supersedes it: the first one is aborted. The
    servo is stopped at every end but that at the dock. Goals are refused while the node is not
    active, in every state: so the server is made once, not each time the node is configured.
    """

    def __init__(
        self, node: ManagedNode, wire: DockRobotWire, settings: Callable[[], DockTaskSettings]
    ) -> None:
        self._node, self._wire, self._settings = node, wire, settings
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
            'dock_robot',
            execute_callback=self._execute,
            goal_callback=self._accept,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
        )

    def configure(self) -> None:
        """Listen to the servo, and look at the clock."""
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._hear, REPORTS)
        self._node.create_timer(PERIOD_S, self._on_tick, clock=self._steady)

    def give_up(self, why: str) -> None:
        """Abort a goal under way, and stop the servo that drives for it."""
        if self._task is not None and self._task.outcome is None:
            self._follow(tasks.end(self._task, Error.UNKNOWN, why))

    def destroy(self) -> None:
        """Take the server from the node."""
        self._server.destroy()

    def _accept(self, goal: Any) -> GoalResponse:
        if self._node.is_active:
            return GoalResponse.ACCEPT
        self._node.get_logger().warning(f'dock_robot refused: {remedy(self._node)}')
        return GoalResponse.REJECT

    async def _execute(self, goal: Any) -> Any:
        if self._task is not None and self._task.outcome is None:  # the new one stops the servo
            before = tasks.end(self._task, Error.UNKNOWN, 'superseded by another goal')
            self._over.set_result(before)
        over = self._over = Future()
        self._goal, self._task = goal, None
        by_id, dock_id = self._wire.request(goal.request)
        task = tasks.accept_request(by_id, dock_id, self._now(), self._settings())
        if not self._node.is_active:  # any more: the goal was accepted just before
            task = replace(tasks.end(task, Error.UNKNOWN, DEACTIVATED), orders=())
        self._follow(task)
        task = await over  # one thread is enough: nothing blocks while it waits
        assert task.outcome is not None
        if task.outcome.canceled and goal.is_cancel_requested:
            goal.canceled()
        elif task.outcome.success:
            goal.succeed()
        else:
            goal.abort()
        return self._wire.result(task, task.outcome)

    def _advance(self, event: Callable[..., Task], *what: Any) -> None:
        """Follow what an event makes of the task, where there is one."""
        if self._task is not None:
            self._follow(event(self._task, *what))

    def _hear(self, message: DiagnosticArray) -> None:
        """Take in phase and reason of the servo, or that it drives as soon as it can."""
        servo = self._node.resolve_service_name(f'{SERVO}/start').rpartition('/')[0]
        if not message.status or message.status[0].name != servo:
            return
        report = read.diagnosis(message)
        word, reason = report.get('phase', ''), report.get('reason', '')
        try:
            phase = None if word == ARMED else phase_named(word)
        except ValueError:
            return  # of another program
        self._advance(tasks.on_report, phase, reason, self._now(), self._settings())

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

    def _on_tick(self) -> None:
        task = self._task
        if task is None or task.outcome is not None:
            return
        if self._goal.is_cancel_requested:
            self._follow(tasks.end(task, Error.NONE, 'canceled', canceled=True))
            return
        self._follow(tasks.on_tick(task, self._now(), self._settings()))
        self._publish()

    def _follow(self, task: Task) -> None:
        """Take over a task: carry out its orders, publish its state, end it if it has ended."""
        before, self._task = self._task, task
        log = self._node.get_logger()
        if before is not None and task.retries > before.retries:
            log.info(f'dock_robot: attempt {task.retries + 1}')
        if task.outcome is not None and not self._over.done():
            error = f' ({task.outcome.error.name})' if task.outcome.error else ''
            log.info(f'dock_robot: {task.outcome.message}{error}')
            self._over.set_result(task)
        elif before is None or task.state is not before.state:
            self._publish()
        for order in task.orders:
            self._order(order)

    def _publish(self) -> None:
        task = self._task
        if task is not None and task.outcome is None and self._goal.is_active:
            seconds = max(self._now() - task.began, 0.0)
            self._goal.publish_feedback(self._wire.feedback(task, seconds))

    def _now(self) -> float:
        return float(self._steady.now().nanoseconds) / NANOSECONDS
