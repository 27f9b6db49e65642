"""Which topic of a bag plays which role: our own names, those of camera drivers, or as told."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from visual_servo_epipolar.bags.reading.bag import Bag, Topic
from visual_servo_epipolar.core.errors import InputError

TWISTS = ('geometry_msgs/msg/Twist', 'geometry_msgs/msg/TwistStamped')
IMAGES = ('sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage')


@dataclass(frozen=True, slots=True)
class Role:
    """What a topic is for: how its name usually ends, and the types that it may have."""

    endings: tuple[str, ...]
    kinds: tuple[str, ...]


ROLES: Mapping[str, Role] = MappingProxyType(
    {
        'image': Role(('image_raw', 'image_raw/compressed', 'image', 'image/compressed'), IMAGES),
        'camera_info': Role(('camera_info',), ('sensor_msgs/msg/CameraInfo',)),
        'desired': Role(('tracker_node/desired/image_raw', 'desired/image_raw'), IMAGES),
        'tracks': Role(('tracks',), ('sensor_msgs/msg/PointCloud2',)),
        'cmd_vel': Role(
            ('cmd_vel',), ('geometry_msgs/msg/Twist', 'geometry_msgs/msg/TwistStamped')
        ),
        'epipoles': Role(('epipoles',), ('sensor_msgs/msg/JointState',)),
        'diagnostics': Role(('diagnostics',), ('diagnostic_msgs/msg/DiagnosticArray',)),
        'ground_truth': Role(('ground_truth',), ('nav_msgs/msg/Odometry',)),
        'tracker_settings': Role(('tracker_node/settings',), ('std_msgs/msg/String',)),
        'servo_settings': Role(('servo_node/settings',), ('std_msgs/msg/String',)),
        'tracker_events': Role(('tracker_node/events',), ('std_msgs/msg/String',)),
        'servo_events': Role(('servo_node/events',), ('std_msgs/msg/String',)),
    }
)
SEEN_BY_OTHERS = ('desired/', 'overlay/')  # images that no camera took just now


def assigned(bag: Bag, told: Mapping[str, str]) -> dict[str, Topic]:
    """
    Return the topic of each role that the bag has one for.

    Parameters
    ----------
    told : mapping
        Names of topics by role, as the user gives them; the others are looked for.

    Raises
    ------
    InputError
        If a topic is not there, has a type that its role cannot use, or if there is a choice.

    """
    found: dict[str, Topic] = {}
    for role in ROLES:
        topic = _told(bag, role, told[role]) if role in told else _looked_for(bag, role, found)
        if topic is not None:
            found[role] = topic
    return found


def parse(words: Iterable[str]) -> dict[str, str]:
    """Return roles and names from words ROLE=NAME; raises InputError for any other."""
    told: dict[str, str] = {}
    for word in words:
        role, equals, name = word.partition('=')
        if not equals or role not in ROLES or not name:
            raise InputError(
                f'--topics takes ROLE=NAME with a role of {", ".join(ROLES)}, got {word!r}'
            )
        told[role] = name
    return told


def _told(bag: Bag, role: str, name: str) -> Topic:
    topic = bag.topics.get(name) or bag.topics.get(f'/{name}')
    if topic is None:
        raise InputError(
            f'{bag.path}: no topic {name!r}; it has {", ".join(bag.topics) or "no topics at all"}'
        )
    if topic.kind not in ROLES[role].kinds:
        raise InputError(
            f'{bag.path}: {role} must be {" or ".join(ROLES[role].kinds)}, but {topic.name} is '
            f'{topic.kind}; name another topic'
        )
    return topic


def _looked_for(bag: Bag, role: str, found: Mapping[str, Topic]) -> Topic | None:
    """Return the topic with the first of the role's names that any topic of its types has."""
    fitting = [
        item
        for item in bag.topics.values()
        if item.kind in ROLES[role].kinds and (role != 'image' or not _is_drawn(item))
    ]
    for ending in ROLES[role].endings:
        named = [item for item in fitting if f'/{item.name}'.endswith(f'/{ending}')]
        if len(named) > 1 and role == 'camera_info' and 'image' in found:
            named = _beside(found['image'], named)
        if len(named) > 1:
            names = ', '.join(item.name for item in named)
            raise InputError(
                f'{bag.path}: {role} may be {names}; say which: --topics {role}={named[0].name}'
            )
        if named:
            return named[0]
    _refuse_wrong_kind(bag, role)
    return fitting[0] if role in ('image', 'camera_info') and len(fitting) == 1 else None


def _is_drawn(topic: Topic) -> bool:
    return any(f'/{part}' in f'/{topic.name}' for part in SEEN_BY_OTHERS)


def _beside(image: Topic, infos: list[Topic]) -> list[Topic]:
    """Return the camera_info in the namespace of ``image``, or all if there is none."""
    space = image.name.removesuffix('/compressed').rpartition('/')[0]
    return [item for item in infos if item.name.rpartition('/')[0] == space] or infos


def _refuse_wrong_kind(bag: Bag, role: str) -> None:
    """Say so when a topic has the right name but a type that cannot be meant."""
    ending, kinds = ROLES[role].endings[0], ROLES[role].kinds
    topic = bag.topics.get(f'/{ending}')
    if topic is not None and topic.kind not in kinds:
        raise InputError(
            f'{bag.path}: {topic.name} must be {" or ".join(kinds)}, got {topic.kind}; name the '
            f'topic that is: --topics {role}=NAME'
        )
