"""Managed node: the life cycle of ROS 2, without the traps of rclpy."""

from collections.abc import Callable
import traceback
from typing import Any

from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn

from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.nodes.lifecycle.gates import (
    answer_the_impossible,
    Callback,
    gate,
    Mailbox,
    ManagedPublisher,
    remedy,
)
from visual_servo_epipolar.nodes.startup.guards import CLOCK, GuardedNode
from visual_servo_epipolar.nodes.startup.settings import LifecycleSettings

SUCCESS, FAILURE, ERROR = (
    TransitionCallbackReturn.SUCCESS,
    TransitionCallbackReturn.FAILURE,
    TransitionCallbackReturn.ERROR,
)
REFUSALS = (VisualServoError, ValueError, OSError)  # what configure and activate may raise


class ManagedNode(GuardedNode, LifecycleNodeMixin):
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

    def __init__(
        self, name: str, *, enable_communication_interface: bool = True, **options: Any
    ) -> None:
        super().__init__(name, **options)
        of_the_node = set(vars(self))
        LifecycleNodeMixin.__init__(
            self, enable_communication_interface=enable_communication_interface
        )
        self.__life_cycle = set(vars(self)) - of_the_node
        self.__created: dict[Any, Callable[[Any], object]] = {}  # and how each is destroyed
        self.__mailboxes: dict[Any, Mailbox] = {}
        self.__state, self.__is_configured, self.__is_starting = 'unconfigured', False, False
        self.__refusal: Exception | None = None  # of the last transition
        self.__is_made = True
        answer_the_impossible(self)

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        for name in vars(cls):
            if name.startswith('on_'):  # would lose what is written here about it
                raise TypeError(f'{cls.__name__}.{name}: write {name[3:]}() instead')

    def configure(self) -> None:
        """Create publishers, subscriptions, timers."""

    def activate(self) -> None:
        """Begin; what is published here is heard if the topic is latched."""

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
            if trigger() != SUCCESS:
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

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Configure; on failure nothing is left of it."""
        self.__state, self.__is_configured = 'configuring', True
        outcome = self.__outcome_of(self.configure)
        if outcome != SUCCESS:
            self.__release()
        return self.__end_in('inactive', outcome, state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Activate, publishers last: a node that failed to has published nothing."""
        self.__state = 'activating'
        outcome = self.__outcome_of(self.__deliver)
        if outcome == SUCCESS:
            outcome = self.__outcome_of(self.activate)
        if outcome == SUCCESS:
            super().on_activate(state)
        return self.__end_in('active', outcome, state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Deactivate, publishers last; a node that failed to must not stay active."""
        self.__state = 'deactivating'
        outcome = self.__outcome_of(self.deactivate)
        super().on_deactivate(state)
        return self.__end_in('inactive', SUCCESS if outcome == SUCCESS else ERROR, state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Clean up, and destroy what was created since; half of that is an error."""
        self.__state = 'cleaningup'
        outcome = self.__outcome_of(self.cleanup)
        self.__release()
        return self.__end_in('unconfigured', SUCCESS if outcome == SUCCESS else ERROR, state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go through what is left of the life; nothing may keep a node from its end."""
        if state.label == 'active':
            self.on_deactivate(state)
        self.on_cleanup(state)
        return self.__end_in('finalized', SUCCESS, state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Fall back to unconfigured, from where the node can be had again."""
        super().on_deactivate(state)
        self.on_cleanup(state)
        return self.__end_in('unconfigured', SUCCESS, state)

    def create_publisher(self, msg_type: Any, topic: str, qos_profile: Any, **more: Any) -> Any:
        """Create a publisher; a managed one, once the node is made."""
        if not self.__is_made:
            return super().create_publisher(msg_type, topic, qos_profile, **more)
        more['publisher_class'] = ManagedPublisher
        publisher: Any = super().create_publisher(msg_type, topic, qos_profile, **more)
        self.add_managed_entity(publisher)
        # destroy_publisher would leave the dead one among the managed entities.
        return self.__remember(self.destroy_lifecycle_publisher, publisher)

    def create_subscription(
        self, msg_type: Any, topic: str, callback: Callback, qos_profile: Any, **more: Any
    ) -> Any:
        """Create a subscription; latched messages wait for the node to be active."""
        create = super().create_subscription
        if not self.__is_made or topic == CLOCK:
            return create(msg_type, topic, callback, qos_profile, **more)
        mailbox = Mailbox(callback, qos_profile)
        callback = gate(callback, lambda: self.is_active, mailbox.keep)
        subscription = create(msg_type, topic, callback, qos_profile, **more)
        self.__mailboxes[subscription] = mailbox
        return self.__remember(self.destroy_subscription, subscription)

    def destroy_subscription(self, subscription: Any) -> bool:
        """Destroy a subscription, and what waits in its mailbox."""
        self.__mailboxes.pop(subscription, None)
        self.keep(subscription)
        return super().destroy_subscription(subscription)

    def create_timer(
        self, timer_period_sec: float, callback: Callback, *rest: Any, **more: Any
    ) -> Any:
        """Create a timer; what falls due while the node is not active is left out."""
        if self.__is_made:
            callback = gate(callback, lambda: self.is_active, lambda: None)
        timer = super().create_timer(timer_period_sec, callback, *rest, **more)
        return self.__remember(self.destroy_timer, timer)

    def create_service(self, srv_type: Any, srv_name: str, callback: Callback, **more: Any) -> Any:
        """Create a service; while the node is not active it answers what to do."""
        if self.__is_made:
            callback = gate(callback, lambda: self.is_active, self.__refuse)
        service = super().create_service(srv_type, srv_name, callback, **more)
        return self.__remember(self.destroy_service, service)

    def create_client(self, srv_type: Any, srv_name: str, **more: Any) -> Any:
        """Create a client."""
        client = super().create_client(srv_type, srv_name, **more)
        return self.__remember(self.destroy_client, client)

    def keep(self, entity: Any) -> None:
        """Leave an entity as it is at the next cleanup: somebody else takes care of it."""
        self.__created.pop(entity, None)

    def __remember(self, destroy: Callable[[Any], object], entity: Any) -> Any:
        """Remember what is created while the node is configured."""
        if self.__is_made and self.__is_configured:
            self.__created[entity] = destroy
        return entity

    def __release(self) -> None:
        """Destroy what was created since the node was unconfigured."""
        while self.__created:
            entity, destroy = self.__created.popitem()
            destroy(entity)
        self.__is_configured = False

    def __end_in(
        self, label: str, outcome: TransitionCallbackReturn, before: LifecycleState
    ) -> TransitionCallbackReturn:
        """Take the state that rclpy takes after this ``outcome``, and return it."""
        self.__state = {SUCCESS: label, FAILURE: before.label}.get(outcome, 'errorprocessing')
        return outcome

    def __deliver(self) -> None:
        for mailbox in list(self.__mailboxes.values()):  # a callback may subscribe
            mailbox.deliver()

    def __refuse(self, request: Any, response: Any) -> Any:
        response.success, response.message = False, remedy(self)
        return response

    def __outcome_of(self, hook: Callable[[], None]) -> TransitionCallbackReturn:
        """Return the outcome of a part of a transition; rclpy would not say why it failed."""
        try:
            hook()
        except Exception as error:  # rclpy swallows it, whatever it is
            self.__refusal = error
            expected = isinstance(error, REFUSALS)
            if not self.__is_starting:  # or the constructor raises it
                text = str(error) if expected else traceback.format_exc()
                self.get_logger().error(f'{hook.__name__.strip("_")} failed: {text}')
            return FAILURE if expected else ERROR
        return SUCCESS
