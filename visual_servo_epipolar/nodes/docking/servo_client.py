"""Client of the servo: its services, its phase, and the reason for it."""

from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from std_srvs.srv import Trigger

from visual_servo_epipolar.core.docking.task import ServoOrder
from visual_servo_epipolar.core.laws.phase import ARMED, Phase
from visual_servo_epipolar.core.laws.registry import phase_named
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.nodes import qos

# Deep, for a phase may last one image; latched, for the servo may stand for hours.
PHASES = QoSProfile(depth=50, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PATIENCE_S = 0.5  # for the diagnostics of a failure: they come after its phase


class ServoClient:
    """
    The servo called ``servo``: calls ``on_phase`` with each phase, ``on_answer`` with answers.

    ``on_armed`` is called where it drives as soon as it can. A failure, and a renewed wait
    without having driven, wait for the reason, if only for a while. Answers are the order, and
    the refusal in words or ''. Orders and their answers pass in every state of the node; the rest
    is for as long as it is configured.
    """

    def __init__(
        self,
        node: Node,
        servo: str,
        on_phase: Callable[[Phase, str], None],
        on_answer: Callable[[ServoOrder, str], None],
        on_armed: Callable[[], None],
    ) -> None:
        self._node, self._on_phase, self._on_answer = node, on_phase, on_answer
        self._on_armed, self._was_armed = on_armed, False
        # Not made by configure: the answer to a start that comes after a cleanup counts as well,
        # and a servo that answers a client that is gone waits in vain.
        self._clients = {
            order: node.create_client(Trigger, f'{servo}/{order.value}') for order in ServoOrder
        }
        self._name = node.resolve_service_name(servo)
        self._said: dict[str, str] = {}  # by its last diagnostics
        self.phase: Phase | None = None
        self._unexplained = False

    def configure(self) -> None:
        """Listen to the servo; what was heard before is forgotten."""
        self._said, self.phase, self._unexplained = {}, None, False
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._patience = self._node.create_timer(PATIENCE_S, self._tell, clock=steady)
        self._patience.cancel()
        self._node.create_subscription(String, 'phase', self._hear, PHASES)
        self._node.create_subscription(
            DiagnosticArray, '/diagnostics', self._explain, qos.DIAGNOSTICS
        )

    def order(self, order: ServoOrder) -> None:
        """Call the service of an ``order``; the answer comes later, a refusal at once."""
        client = self._clients[order]
        if not client.service_is_ready():
            service = self._node.resolve_service_name(client.srv_name)
            refusal = (
                f'service {service} is not available; run the servo, or set servo to its name'
            )
            self._on_answer(order, refusal)
            return
        future = client.call_async(Trigger.Request())
        future.add_done_callback(lambda answer: self._answer(order, answer))

    def _answer(self, order: ServoOrder, future: Any) -> None:
        response = future.result()
        self._on_answer(order, '' if response.success else f'{order.value}: {response.message}')

    def _hear(self, message: String) -> None:
        was_armed, self._was_armed = self._was_armed, message.data == ARMED
        if self._was_armed:
            self._tell()
            self.phase = None
            self._on_armed()
            return
        try:
            phase = phase_named(message.data)
        except ValueError:
            return  # of another program
        if self._unexplained and phase is self.phase:
            return
        self._tell()  # what waited until now
        self.phase, self._unexplained = phase, True
        lapsed = was_armed and phase is Phase.WAITING
        if (phase is Phase.FAILED or lapsed) and not self._is_explained:
            self._patience.reset()
        else:
            self._tell()

    def _explain(self, message: DiagnosticArray) -> None:
        if message.status and message.status[0].name == self._name:
            self._said = read.diagnosis(message)
            if self._is_explained:
                self._tell()

    @property
    def _is_explained(self) -> bool:
        """Whether the last diagnostics are of this phase."""
        return self.phase is not None and self._said.get('phase') == self.phase.value

    def _tell(self) -> None:
        """Hand on a phase that was not handed on yet, with its reason or without."""
        self._patience.cancel()
        if self._unexplained and self.phase is not None:
            self._unexplained = False
            reason = self._said.get('reason', '') if self._is_explained else ''
            self._on_phase(self.phase, reason)
