"""Nodes of this package: parameters as they are given, and a managed life cycle."""

from collections.abc import Callable, Iterator
from functools import wraps
import traceback
from typing import Any, TypeVar
from weakref import WeakSet

from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState
from rclpy.lifecycle import TransitionCallbackReturn as Outcome
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.core.settings import hint
from visual_servo_epipolar.nodes.startup.settings import LifecycleSettings

Callback = Callable[..., Any]
CallbackT = TypeVar('CallbackT', bound=Callback)
REFUSALS = (VisualServoError, ValueError, OSError)  # what configure and activate may raise
REMEDIES = {
    'unconfigured': 'call ros2 lifecycle set {name} configure, then activate',
    'inactive': 'call ros2 lifecycle set {name} activate',
    'finalized': 'start it anew',
}
CLOCK = '/clock'


class ParameterNode(Node):
    """
    Node that keeps what it is given until it is declared, by ``parameters.declare``.

    It refuses a parameter of no type, and a /clock below zero, which rclpy raises out of spin.
    ``given`` are the parameters of files and command line, by name, declared or not,
    ``by_program`` the names of those that the program gives that makes the node.
    """

    def __init__(self, name: str, **options: Any) -> None:
        self.given: dict[str, Parameter] = {}
        self.by_program = {item.name for item in options.get('parameter_overrides') or ()}
        super().__init__(name, automatically_declare_parameters_from_overrides=True, **options)

    def declare_parameters(
        self, namespace: str, parameters: list[Any], ignore_override: bool = False
    ) -> list[Parameter]:
        """Declare parameters; of those that rclpy declares as given, by no kind, take note."""
        if not ignore_override:
            return super().declare_parameters(namespace, parameters)
        self.given = {name: Parameter(name, value=value) for name, value, *_ in parameters}
        return []

    def create_service(self, srv_type: Any, srv_name: str, callback: Callback, **more: Any) -> Any:
        """Create a service; those of rclpy that change parameters refuse unknown types."""
        if srv_type in (SetParameters, SetParametersAtomically):
            callback = _refusing_unknown_types(callback)
        return super().create_service(srv_type, srv_name, callback, **more)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Any, qos_profile: Any, **more: Any
    ) -> Any:
        """Create a subscription; that of rclpy to /clock leaves times below zero out."""
        if topic == CLOCK and not more.get('raw'):
            callback = _refusing_negative_times(self, callback)
        return super().create_subscription(msg_type, topic, callback, qos_profile, **more)

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set all parameters or none; a name that is misspelt is named, which rclpy does not."""
        foreign = [item.name for item in parameter_list if not self.has_parameter(item.name)]
        if foreign:
            known = sorted(self.list_parameters([], 0).names)
            reason = f'{self.get_name()} has no parameter {foreign[0]}; {hint(foreign[:1], known)}'
            return SetParametersResult(successful=False, reason=reason)
        return super().set_parameters_atomically(parameter_list)


def _refusing_unknown_types(plain: Callback) -> Callback:
    """Return the callback of a service that changes parameters, which refuses unknown types."""
    last = max(item.value for item in Parameter.Type)

    def change(request: Any, response: Any) -> Any:
        unknown = [item for item in request.parameters if item.value.type > last]
        if not unknown:
            return plain(request, response)
        name, number = unknown[0].name, unknown[0].value.type
        reason = f'{name!r:.40} must have a type from 0 to {last}, got {number}'
        refusal = SetParametersResult(successful=False, reason=reason)
        if hasattr(response, 'results'):
            response.results = [refusal] * len(request.parameters)
        else:
            response.result = refusal
        return response

    return change


def _refusing_negative_times(node: Node, plain: Callback) -> Callback:
    """Return the callback of /clock that leaves times out which rclpy has none for."""

    def tell(message: Clock) -> None:
        if message.clock.sec >= 0:
            plain(message)
        else:
            node.get_logger().error(
                '/clock is below 0, it is left out; mend what publishes it',
                throttle_duration_sec=30.0,
            )

    return tell


def in_every_state(callback: CallbackT) -> CallbackT:
    """
    Mark a callback that is called in every state of a managed node.

    Such is what stops the robot, and what takes in latched messages, which are not sent again.
    """
    callback.in_every_state = True  # type: ignore[attr-defined]
    return callback


class ManagedNode(ParameterNode, LifecycleNodeMixin):
    """
    Node with a life cycle: unconfigured, inactive, active.

    A kind of node has its settings and services in its constructor, which ends with
    ``autostart``, and writes what else it does into ``configure``, ``activate``, ``deactivate``
    and ``cleanup``. These return nothing. ``configure`` and ``activate`` raise VisualServoError,
    ValueError or OSError where they cannot: the node stays in the state it was in.

    Subscriptions, timers and services call back only while the node is active, but for callbacks
    marked ``in_every_state``; other services answer what to do. What is created by ``configure``
    or later is destroyed after ``cleanup``, unless it is ``keep``-ed.
    """

    __is_made = False  # until then rclpy creates what is its own; no kind of node has the names

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        of_the_node = set(vars(self))
        LifecycleNodeMixin.__init__(self)
        self.__life_cycle = set(vars(self)) - of_the_node
        self.__kept: WeakSet[Any] = WeakSet()  # entities that outlive a cleanup
        self.__state, self.__is_configured, self.__is_starting = 'unconfigured', False, False
        self.__refusal: Exception | None = None  # of the last transition
        self.__is_made = True
        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = self.__refusing_the_impossible(service.callback)

    def configure(self) -> None:
        """Create publishers, subscriptions, timers."""

    def activate(self) -> None:
        """Begin; what is published here is heard."""

    def deactivate(self) -> None:
        """Come to rest; what is published here is still heard."""

    def cleanup(self) -> None:
        """Forget; is called in any state, also twice."""

    def autostart(self, settings: LifecycleSettings) -> None:
        """Configure and activate, unless the settings leave it to others; raise what kept it."""
        if not settings.autostart_node:
            self.get_logger().info(f'autostart_node is false: {remedy(self)}')
            return
        self.__is_starting = True
        for trigger in (self.trigger_configure, self.trigger_activate):
            if trigger() != Outcome.SUCCESS:
                refusal = self.__refusal or RuntimeError('no reason is known')
                self.destroy_node()  # or its name stays taken
                raise refusal
        self.__is_starting = False

    def destroy_node(self) -> None:
        """Destroy the node, and let its life cycle go, which would keep its name on the graph."""
        self.__state = 'finalized'
        super().destroy_node()
        while self.__life_cycle:
            delattr(self, self.__life_cycle.pop())

    @property
    def state(self) -> str:
        """The state by its label, or that of the transition under way: activating, ..."""
        return self.__state

    @property
    def is_active(self) -> bool:
        """Whether callbacks are called, and what is published goes out."""
        return self.state == 'active'

    @property
    def is_configured(self) -> bool:
        """Whether there is what ``configure`` creates."""
        return self.__is_configured

    def on_configure(self, state: LifecycleState) -> Outcome:
        """Configure; on failure nothing is left of it."""
        self.__kept.update(entity for entity, _ in self.__entities())
        self.__is_configured = True
        outcome = self.__carry_out(self.configure, 'configuring', 'inactive', state)
        if outcome != Outcome.SUCCESS:
            self.__release()
        return outcome

    def on_activate(self, state: LifecycleState) -> Outcome:
        """Activate, publishers first; those of a node that failed to are silent again."""
        super().on_activate(state)
        outcome = self.__carry_out(self.activate, 'activating', 'active', state)
        if outcome != Outcome.SUCCESS:
            super().on_deactivate(state)
        return outcome

    def on_deactivate(self, state: LifecycleState) -> Outcome:
        """Deactivate, publishers last; a node that failed to must not stay active."""
        outcome = self.__carry_out(self.deactivate, 'deactivating', 'inactive')
        super().on_deactivate(state)
        return outcome

    def on_cleanup(self, state: LifecycleState) -> Outcome:
        """Clean up, and destroy what was created since; half of that is an error."""
        outcome = self.__carry_out(self.cleanup, 'cleaningup', 'unconfigured')
        self.__release()
        return outcome

    def on_shutdown(self, state: LifecycleState) -> Outcome:
        """Go through what is left of the life; nothing may keep a node from its end."""
        if state.label == 'active':
            self.on_deactivate(state)
        self.on_cleanup(state)
        self.__state = 'finalized'
        return Outcome.SUCCESS

    def on_error(self, state: LifecycleState) -> Outcome:
        """Fall back to unconfigured, from where the node can be had again."""
        super().on_deactivate(state)
        self.on_cleanup(state)
        self.__state = 'unconfigured'
        return Outcome.SUCCESS

    def create_publisher(self, msg_type: Any, topic: str, qos_profile: Any, **more: Any) -> Any:
        """Create a publisher; once the node is made one that is silent while it is inactive."""
        create = super().create_publisher
        if self.__is_made:
            create = self.create_lifecycle_publisher
        return create(msg_type, topic, qos_profile, **more)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Any, qos_profile: Any, **more: Any
    ) -> Any:
        """Create a subscription; what comes while the node is not active is dropped."""
        callback = callback if topic == CLOCK else self.__gated(callback)
        subscription = super().create_subscription(msg_type, topic, callback, qos_profile, **more)
        if topic == CLOCK and self.__is_made:  # use_sim_time was set in mid-life
            self.keep(subscription)
        return subscription

    def create_timer(
        self, timer_period_sec: float, callback: Callback, *rest: Any, **more: Any
    ) -> Any:
        """Create a timer; what falls due while the node is not active is left out."""
        return super().create_timer(timer_period_sec, self.__gated(callback), *rest, **more)

    def create_service(self, srv_type: Any, srv_name: str, callback: Callback, **more: Any) -> Any:
        """Create a service; while the node is not active it answers what to do."""

        def refuse(request: Any, response: Any) -> Any:
            response.success, response.message = False, remedy(self)
            return response

        return super().create_service(srv_type, srv_name, self.__gated(callback, refuse), **more)

    def keep(self, entity: Any) -> None:
        """Leave an entity as it is at the next cleanup: another takes care of it."""
        self.__kept.add(entity)

    def __gated(self, callback: Callback, otherwise: Callback = lambda *_: None) -> Callback:
        """Return a callback that calls ``otherwise`` while the node is not active."""
        if not self.__is_made or getattr(callback, 'in_every_state', False):
            return callback

        @wraps(callback)  # rclpy looks at its signature
        def pass_on(*arguments: Any) -> Any:
            return (callback if self.is_active else otherwise)(*arguments)

        return pass_on

    def __entities(self) -> Iterator[tuple[Any, Callable[[Any], object]]]:
        """Yield what the node has, and how each is destroyed."""
        for entities, destroy in (
            (self.timers, self.destroy_timer),
            (self.subscriptions, self.destroy_subscription),
            (self.services, self.destroy_service),
            (self.clients, self.destroy_client),
            # destroy_publisher would leave the dead one among the managed entities.
            (self.publishers, self.destroy_lifecycle_publisher),
        ):
            yield from ((entity, destroy) for entity in list(entities))

    def __release(self) -> None:
        """Destroy what was created since the node was unconfigured."""
        for entity, destroy in self.__entities():
            if self.__is_configured and entity not in self.__kept:
                destroy(entity)
        self.__is_configured = False

    def __carry_out(
        self, hook: Callable[[], None], now: str, then: str, before: LifecycleState | None = None
    ) -> Outcome:
        """
        Return the outcome of a part of a transition, in the state that rclpy takes by it.

        rclpy would not say why it failed. A refusal keeps the state ``before``, if it is given.
        """
        self.__state = now
        try:
            hook()
        except Exception as error:  # rclpy swallows it, whatever it is
            self.__refusal = error
            expected = isinstance(error, REFUSALS)
            if not self.__is_starting:  # or the constructor raises it
                text = str(error) if expected else traceback.format_exc()
                self.get_logger().error(f'{hook.__name__} failed: {text}')
            kept = before if expected else None
            self.__state = 'errorprocessing' if kept is None else kept.label
            return Outcome.ERROR if kept is None else Outcome.FAILURE
        self.__state = then
        return Outcome.SUCCESS

    def __refusing_the_impossible(self, change: Callback) -> Callback:
        """Return a service that refuses what the state does not allow (rclpy#1209)."""

        def answer(request: Any, response: Any) -> Any:
            try:
                return change(request, response)
            except RuntimeError:  # RCLError
                wanted = request.transition.label or f'with the id {request.transition.id}'
                text = f'{self.get_fully_qualified_name()} is {self.state}'
                self.get_logger().warning(f'{text}: there is no transition {wanted}')
                response.success = False
                return response

        return answer


def remedy(node: ManagedNode) -> str:
    """Return in which state a node is, and how it becomes active."""
    name = node.get_fully_qualified_name()
    return f'{name} is {node.state}; {REMEDIES.get(node.state, "try again").format(name=name)}'


def serve(
    node: Node, name: str, action: Callable[[], str], done: str = '', refused: str = ''
) -> None:
    """Serve ``name`` by an ``action`` that is marked ``in_every_state`` or not; see carry_out."""

    def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = carry_out(node, action, done, refused)
        return response

    always = getattr(action, 'in_every_state', False)
    node.create_service(Trigger, name, in_every_state(answer) if always else answer)


def carry_out(
    node: Node, action: Callable[[], str], done: str = '', refused: str = ''
) -> tuple[bool, str]:
    """
    Return whether an ``action`` was done, and the text that it returns, or raises as a refusal.

    The text is logged within ``done`` or ``refused``, where there is one.
    """
    success = True
    try:
        text = action()
    except (VisualServoError, ValueError) as error:
        success, text = False, str(error)
    if success and done:
        node.get_logger().info(done.format(text))
    elif not success and refused:
        node.get_logger().warning(refused.format(text))
    return success, text
