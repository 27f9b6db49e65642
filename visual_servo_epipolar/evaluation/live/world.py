"""The world of a run: the real nodes on a wire, which can be killed, hung, restarted, ordered."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import asdict, dataclass, field
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.stamps import NANOSECONDS
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.evaluation.live.wire import BEGIN_NS, Envelope, hook_rclpy, Wire
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.camera_node import CameraNode
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.nodes.startup import complaints
from visual_servo_epipolar.nodes.startup.executor import isolated_context, new_node
from visual_servo_epipolar.nodes.tracker_node import TrackerNode
from visual_servo_epipolar.nodes.unicycle_node import UnicycleNode
from visual_servo_epipolar.simulation.bases.pioneer import Pioneer, PioneerSettings
from visual_servo_epipolar.simulation.bases.registry import SimulatedBase
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings

BASE_RATE = 50.0  # [Hz]
CLOCK = '/clock'
FRAME_RATE = CameraSettings.frame_rate
WIDTH, HEIGHT = 320, 256  # [px], a quarter of the default camera each way
RUN_TIMEOUT_S = 150.0
MAX_RETREAT_M = 1.0  # as in docs/robot.md for first drives
TIMES = ('stale_timeout', 'max_latency')  # what a servo was given of them at its start [s]


class BreakablePioneer(Pioneer):
    """A base that can break: ``grip`` is what is left of each wheel's motion, 0 is stuck."""

    grip = (1.0, 1.0)

    def _true(self, linear: float, angular: float) -> tuple[float, float]:
        linear, angular = super()._true(linear, angular)
        half = 0.5 * self.settings.track
        left, right = self.grip
        left, right = left * (linear - half * angular), right * (linear + half * angular)
        return 0.5 * (left + right), (right - left) / self.settings.track


class BreakableUnicycleNode(UnicycleNode):
    """The node of the base, with one that can break."""

    def break_wheels(self, left: float, right: float) -> None:
        """Leave of each wheel's motion this part."""
        assert isinstance(self._base, BreakablePioneer)
        self._base.grip = left, right

    def _new_base(self) -> SimulatedBase:
        start = Pose.from_start(*self._settings.start)
        now_ns = int(self._steady.now().nanoseconds)
        return BreakablePioneer(
            self._base_settings, start, seed=self._settings.seed, now_ns=now_ns
        )


# The name of the executable stays.
BreakableUnicycleNode.__name__ = UnicycleNode.__name__


NODES: Mapping[str, type[Any]] = {
    'servo_node': ServoNode,
    'tracker_node': TrackerNode,
    'camera_node': CameraNode,
    'unicycle_node': BreakableUnicycleNode,
}


@dataclass(frozen=True, kw_only=True)
class WorldSettings:
    """
    How a world is built: ``kinds`` of its nodes by name, ``more`` parameters of each.

    ``simulated_time`` is that of /clock.
    """

    start: tuple[float, float, float]
    seed: int
    camera: CameraSettings
    base: PioneerSettings = field(default_factory=PioneerSettings)
    servo: ServoSettings = field(
        default_factory=lambda: ServoSettings(
            autostart=True, run_timeout=RUN_TIMEOUT_S, max_retreat=MAX_RETREAT_M
        )
    )
    kinds: Mapping[str, type[Any]] = field(default_factory=lambda: NODES)
    more: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    simulated_time: bool = False
    depth: float = 1.0  # over that of the scene that is seen


class World(AbstractContextManager['World']):
    """
    Real nodes and a wire; no other process sees them.

    ``nodes`` are those that live, by name, ``given`` the TIMES that each was given. What happens
    to one is what happens to its process.
    """

    def __init__(self, settings: WorldSettings) -> None:
        self.settings, self.wire = settings, Wire()
        self.nodes: dict[str, Node] = {}
        self.given: dict[str, dict[str, float]] = {}
        self._stack = ExitStack()
        with ExitStack() as stack:
            self._context = stack.enter_context(isolated_context())
            stack.enter_context(hook_rclpy(self.wire))
            stack.callback(self._destroy)
            if settings.simulated_time:
                self._tick()
            self._stack = stack.pop_all()

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def start(self, name: str, *, alias: str = '') -> None:
        """Start a node; as ``alias`` it is one more of its kind."""
        known = alias or name
        more = {'use_sim_time': self.settings.simulated_time, **self.settings.more.get(name, {})}
        node = new_node(
            self.settings.kinds[name], self._context, {**self._values(name), **more}, name=known
        )
        complaints.watch(node)  # as spin() does
        self.nodes[known] = node
        self.wire.add(node)
        numbers = (int, float)
        given = {key: node.get_parameter(key).value for key in TIMES if node.has_parameter(key)}
        self.given[known] = {
            key: float(it) for key, it in given.items() if isinstance(it, numbers)
        }

    def talker(self, name: str, kind: Any, topic: str) -> Callable[[Any], None]:
        """Return what publishes on ``topic``, as a node of that ``name`` does that is not ours."""
        node = rclpy.create_node(name, context=self._context)
        self._stack.callback(node.destroy_node)
        publish: Callable[[Any], None] = node.create_publisher(kind, topic, 1).publish
        return publish

    def kill(self, name: str) -> None:
        """Let a node be gone, without a word."""
        node = self.nodes.pop(name, None)
        if node is not None:
            self.wire.remove(node)
            node.destroy_node()

    def end(self, name: str) -> None:
        """End a node as SIGINT does."""
        node = self.nodes.get(name)
        stop = getattr(node, 'stop', None)
        if node is not None and stop is not None:
            self.wire.call(node, stop)
        self.kill(name)

    def restart(self, name: str) -> None:
        """Start a node that is gone, or replace the one that is there."""
        self.kill(name)
        self.start(name)

    def hang(self, name: str) -> None:
        """Let a node do nothing (SIGSTOP)."""
        if name in self.nodes:
            self.wire.hang(self.nodes[name])

    def resume(self, name: str) -> None:
        """Let a node go on (SIGCONT)."""
        if name in self.nodes:
            self.wire.resume(self.nodes[name])

    def works(self, name: str) -> bool:
        """Return whether a node lives and does not hang."""
        return name in self.nodes and self.wire.works(self.nodes[name])

    def call(self, service: str) -> str:
        """Call a service (std_srvs/Trigger), as /servo_node/stop, and return its answer."""
        answer = self._ask(service)
        return '' if answer is None else str(answer.message)

    def change_state(self, name: str, label: str) -> str:
        """Ask a managed node for a transition, as others do: by its service; return the answer."""
        service = f'/{name}/change_state'
        if name not in self.nodes:
            return f'no {service}'
        answer = self._ask(service, lambda request: setattr(request.transition, 'label', label))
        return 'done' if answer is not None and answer.success else 'refused'

    def _ask(self, service: str, fill: Callable[[Any], object] = lambda request: None) -> Any:
        """Return the answer of a service; None where no node serves it, or its node dies of it."""
        for node in list(self.nodes.values()):
            for item in node.services:
                if item.service_name == service:
                    kind: Any = item.srv_type
                    request = kind.Request()
                    fill(request)
                    return self.wire.call(node, item.callback, request, kind.Response())
        return None

    def set(self, name: str, values: Mapping[str, Any]) -> str:
        """Set parameters of a node, all or none, and return why it refused, or ''."""
        node = self.nodes.get(name)
        if node is None:
            return f'no {name}'
        wanted = [Parameter(key, value=value) for key, value in values.items()]
        result = self.wire.call(node, node.set_parameters_atomically, wanted)
        return '' if result is None or result.successful else str(result.reason)

    @property
    def delay_s(self) -> float:
        """How long a command takes to the motors, by now [s]."""
        base = self.nodes.get('unicycle_node')
        return 0.0 if base is None else float(base.get_parameter('command_delay').value)

    def run_for(self, seconds: float) -> None:
        """Let time pass."""
        self.wire.run_until(self.wire.now_ns + round(seconds * NANOSECONDS))

    def _tick(self) -> None:
        """Publish /clock, now and for ever."""
        wire = self.wire
        wire.post(Envelope(CLOCK, write.clock(wire.now_ns - BEGIN_NS + NANOSECONDS), 0))
        wire.at(wire.now_ns + round(NANOSECONDS / BASE_RATE), self._tick)

    def _values(self, name: str) -> dict[str, Any]:
        it = self.settings
        if name == 'unicycle_node':
            return {
                **asdict(it.base),
                'start': it.start,
                'seed': it.seed,
                'rate': BASE_RATE,
                'frame_rate': it.camera.frame_rate,
            }
        own = {'servo_node': it.servo, 'camera_node': it.camera, 'tracker_node': TrackerSettings()}
        return asdict(own[name])

    def _destroy(self) -> None:
        for name in list(self.nodes):
            self.kill(name)


def small_camera(seed: int) -> CameraSettings:
    """Return the default camera with 4x4 pixels binned."""
    full = CameraSettings()
    ratio_u, ratio_v = WIDTH / full.width, HEIGHT / full.height
    return CameraSettings(
        width=WIDTH,
        height=HEIGHT,
        focal_length=ratio_u * full.focal_length,
        principal_u=ratio_u * (full.principal_u + 0.5) - 0.5,
        principal_v=ratio_v * (full.principal_v + 0.5) - 0.5,
        seed=seed,
    )
