"""Action server of docking: hands goals to the servo as tasks of the core, one at a time."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.clock import Clock, ClockType
from rclpy.task import Future
from sensor_msgs.msg import BatteryState

from visual_servo_epipolar.core.docking import task as tasks
from visual_servo_epipolar.core.docking.settings import DockTaskSettings
from visual_servo_epipolar.core.docking.task import Outcome, ServoOrder, Task
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.messages import docking
from visual_servo_epipolar.messages.docking import DockRobotWire
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.docking.servo_client import ServoClient
from visual_servo_epipolar.nodes.lifecycle.gates import remedy
from visual_servo_epipolar.nodes.lifecycle.managed_node import ManagedNode

ACTION = 'dock_robot'
PERIOD_S = 0.1  # of feedback, and of looking at the clock
DEACTIVATED = 'the node was deactivated before it had docked'


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
        servo: str,
        settings: DockTaskSettings,
        refusal: Callable[[], str],
    ) -> None:
        self.settings, self._refusal = settings, refusal
        self._node, self._wire = node, wire
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._goal: Any = None
        self._task: Task | None = None
        self._over = Future()
        self._servo = ServoClient(node, servo, self._on_phase, self._on_answer, self._on_armed)
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
        self._servo.configure()
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
        if self._servo.phase is not None:
            self._on_phase(self._servo.phase, '')
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

    def _on_phase(self, phase: Phase, reason: str) -> None:
        self._advance(tasks.on_phase, phase, reason, self._now(), self.settings)

    def _on_armed(self) -> None:
        self._advance(tasks.on_armed, self._now())

    def _on_answer(self, order: ServoOrder, refusal: str) -> None:
        self._advance(tasks.on_answer, order, refusal, self._now())

    def _on_battery(self, message: BatteryState) -> None:
        self._advance(tasks.on_battery, docking.current(message), self.settings)

    def _on_tick(self) -> None:
        task = self._task
        if task is None or task.outcome is not None:
            return
        if self._goal.is_cancel_requested:
            self._follow(tasks.cancel(task, 'canceled'))
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
            self._servo.order(order)

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
