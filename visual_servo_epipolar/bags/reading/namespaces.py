"""Namespaces of a bag: which robots it has, and which topics are those of one of them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from visual_servo_epipolar.bags.reading.bag import Bag, BagTopic
from visual_servo_epipolar.core.errors import InputError

# What only tracker and servo publish; others have images, commands and tracks as well.
OWN: Mapping[str, str] = MappingProxyType(
    {
        'epipoles': 'sensor_msgs/msg/JointState',
        'tracker_node/settings': 'std_msgs/msg/String',
        'servo_node/settings': 'std_msgs/msg/String',
    }
)
TRACKS = MappingProxyType({'tracks': 'sensor_msgs/msg/PointCloud2'})


@dataclass(frozen=True, slots=True)
class Namespace:
    """Namespace of a robot, '' for the root, beside those of the ``others`` in the bag."""

    name: str
    others: tuple[str, ...] = ()
    note: str = ''

    def holds(self, topic: str) -> bool:
        """Return whether a topic lies in it, and not in one of the others below it."""
        deeper = [other for other in self.others if other.startswith(f'{self.name}/')]
        return _is_in(topic, self.name) and not any(_is_in(topic, other) for other in deeper)

    def may_share(self, topic: str) -> bool:
        """Return whether a topic outside of it may serve it: it is none of another robot."""
        return topic == '/diagnostics' or not any(_is_in(topic, other) for other in self.others)

    def has_node(self, name: str) -> bool:
        """Return whether the node of this full name is in it."""
        return name.rpartition('/')[0] == self.name


def namespace_of(
    bag: Bag, requested: Iterable[str] = (), wanted: str | None = None
) -> Namespace | None:
    """
    Return the namespace to read, None where the bag gives no reason to choose one.

    It is the one ``wanted`` (``/`` is the root), or that of all topics ``requested``. Raises
    InputError if nothing is in it, or if there are several robots and no word on which.
    """
    robots = robot_namespaces(bag)
    if wanted is not None:
        return _namespace_called(bag, robots, '/'.join(['', *filter(None, wanted.split('/'))]))
    if len(robots) < 2:
        if robots in ([], ['']):
            return None
        return Namespace(robots[0], note=f'topics are those in namespace {robots[0]}')
    names = [f'/{name.lstrip("/")}' for name in requested]
    choices = [_beside(name, robots) for name in robots]
    holding = [item for item in choices if any(item.holds(name) for name in names)]
    if len(holding) == 1:
        return holding[0]
    if holding:
        return None  # of several robots, by name: what is not named must be clear by itself
    shown = ' and '.join(name or '/' for name in robots)
    raise InputError(
        f'{bag.path}: topics of {len(robots)} robots, in {shown}; say which: '
        f'--namespace {robots[-1]}'
    )


def robot_namespaces(bag: Bag) -> list[str]:
    """Return the namespaces in which a tracker or a servo published, '' for the root."""
    return _publishing(bag.topics.values(), OWN) or _publishing(bag.topics.values(), TRACKS)


def _publishing(topics: Iterable[BagTopic], endings: Mapping[str, str]) -> list[str]:
    return sorted(
        {
            item.name.removesuffix(f'/{ending}')
            for item in topics
            for ending, kind in endings.items()
            if item.kind == kind and item.name.endswith(f'/{ending}')
        }
    )


def _namespace_called(bag: Bag, robots: list[str], name: str) -> Namespace:
    namespace = _beside('' if name == '/' else name, robots)
    if not any(namespace.holds(topic) for topic in bag.topics):
        spaces = ', '.join(item or '/' for item in robots) or 'none of a tracker or servo'
        raise InputError(f'{bag.path}: no topic in namespace {name}; it has {spaces}')
    return namespace


def _beside(name: str, robots: Iterable[str]) -> Namespace:
    return Namespace(name, tuple(other for other in robots if other != name))


def _is_in(topic: str, namespace: str) -> bool:
    return topic.startswith(f'{namespace}/')
