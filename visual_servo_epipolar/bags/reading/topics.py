"""Topics of a bag: which roles they have in its run."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass

from visual_servo_epipolar.bags.reading.bag import Bag, BagTopic
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.messages.settings_text import from_text
from visual_servo_epipolar.messages.validation import of_two_cameras

TWISTS = ('geometry_msgs/msg/Twist', 'geometry_msgs/msg/TwistStamped')
IMAGES = ('sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage')


@dataclass(frozen=True, slots=True)
class Role:
    """Role of a topic: how its name usually ends, and the types that it may have."""

    endings: tuple[str, ...]
    kinds: tuple[str, ...]


ROLES: Mapping[str, Role] = {
    'image': Role(('image_raw', 'image_raw/compressed', 'image', 'image/compressed'), IMAGES),
    'camera_info': Role(('camera_info',), ('sensor_msgs/msg/CameraInfo',)),
    'desired': Role(
        (
            'tracker_node/desired/image_raw',
            'desired/image_raw',
            'desired/image_raw/compressed',
        ),
        IMAGES,
    ),
    'tracks': Role(('tracks',), ('sensor_msgs/msg/PointCloud2',)),
    'cmd_vel': Role(('cmd_vel',), TWISTS),
    'epipoles': Role(('epipoles',), ('sensor_msgs/msg/JointState',)),
    'diagnostics': Role(('diagnostics',), ('diagnostic_msgs/msg/DiagnosticArray',)),
    'ground_truth': Role(('ground_truth',), ('nav_msgs/msg/Odometry',)),
    'tracker_settings': Role(('tracker_node/settings',), ('std_msgs/msg/String',)),
    'servo_settings': Role(('servo_node/settings',), ('std_msgs/msg/String',)),
    'tracker_events': Role(('tracker_node/events',), ('std_msgs/msg/String',)),
    'servo_events': Role(('servo_node/events',), ('std_msgs/msg/String',)),
}
DERIVED_IMAGES = ('desired/', 'overlay/')  # images that are not straight from a camera


def assign_roles(
    bag: Bag,
    requested: Mapping[str, str],
    namespace: str | None = None,
    roles: Iterable[str] = ROLES,
) -> dict[str, BagTopic]:
    """
    Return the topic of each of ``roles`` that the bag has one for.

    Those that are ``requested``, names by role, are taken; others are inferred, of the topics in
    ``namespace`` alone if it is given, as /robot1, and /diagnostics. Raises InputError if a topic
    is missing, has a type that its role cannot use, or if there is a choice.
    """
    choice = list(bag.topics.values())
    if namespace is not None:
        choice = [item for item in choice if item.name.startswith(f'{namespace}/')]
        if not choice:
            raise InputError(
                f'{bag.path}: no topic in namespace {namespace}; it has {", ".join(bag.topics)}'
            )
        choice += filter(None, [bag.topics.get('/diagnostics')])
    topics: dict[str, BagTopic] = {}
    for role in roles:
        name = requested.get(role)
        if name is not None:
            topic: BagTopic | None = _find_requested(bag, role, name)
        else:
            topic = _infer(bag, role, topics, choice)
        if topic is not None:
            topics[role] = topic
    if 'image' in topics and 'image' not in requested:
        topics['image'] = _as_transported(bag, topics)
    return topics


def _as_transported(bag: Bag, topics: Mapping[str, BagTopic]) -> BagTopic:
    """Return the topic of the images that the tracker took, where they came raw and compressed."""
    image, settings = topics['image'], topics.get('tracker_settings')
    compressed = bag.topics.get(f'{image.name}/compressed')
    if settings is None or compressed is None or compressed.kind not in IMAGES:
        return image
    first = next(iter(bag.messages([settings.name])), None)
    with suppress(ValueError):  # settings of no use: their reader reports it
        if first and from_text(first.message.data).values.get('transport') == 'compressed':
            return compressed
    return image


def camera_notes(
    bag: Bag, topics: Mapping[str, BagTopic], requested: Mapping[str, str]
) -> list[str]:
    """
    Return what to note of a camera_info that is not beside its images, or not of their frame.

    Raises InputError if it is neither: another camera's. The user may have ``requested`` it.
    """
    image, info = topics.get('image'), topics.get('camera_info')
    if image is None or info is None or 'camera_info' in requested:
        return []
    is_beside = bool(_beside(image, [info], or_all=False))
    frames = _frame(bag, image), _frame(bag, info)
    doubt = of_two_cameras((image.name, info.name), frames)
    if doubt and all(frames) and not is_beside:
        raise InputError(
            f'{bag.path}: {info.name} is of the frame {frames[1]}, {image.name} of {frames[0]}: '
            f"it is another camera's; say which: --topics camera_info={info.name}, or --camera "
            'FILE.yaml'
        )
    if not doubt and not is_beside:
        doubt = f'{info.name} is taken for {image.name}, by their frame_id alone'
    return [doubt] if doubt else []


def _frame(bag: Bag, topic: BagTopic) -> str:
    """Return the frame_id of the first message of a topic, without the slash of ROS 1."""
    first = next(iter(bag.messages([topic.name])), None)
    return '' if first is None else str(first.message.header.frame_id).lstrip('/')


def parse(words: Iterable[str]) -> dict[str, str]:
    """Return roles and names from words ROLE=NAME; raises InputError for any other."""
    requested: dict[str, str] = {}
    for word in words:
        role, equals, name = word.partition('=')
        if not equals or role not in ROLES or not name:
            raise InputError(
                f'--topics takes ROLE=NAME with a role of {", ".join(ROLES)}, got {word!r}'
            )
        requested[role] = name
    return requested


def _find_requested(bag: Bag, role: str, name: str) -> BagTopic:
    topic = bag.topics.get(name) or bag.topics.get(f'/{name}')
    if topic is None:
        names = ', '.join(bag.topics) or 'no topics at all'
        raise InputError('; '.join([f'{bag.path}: no topic {name!r}; it has {names}', *bag.notes]))
    if topic.kind not in ROLES[role].kinds:
        raise InputError(
            f'{bag.path}: {role} must be {" or ".join(ROLES[role].kinds)}, but {topic.name} is '
            f'{topic.kind}; name another topic'
        )
    return topic


def _infer(
    bag: Bag, role: str, topics: Mapping[str, BagTopic], choice: Iterable[BagTopic]
) -> BagTopic | None:
    """Return the topic of a fitting type that has the first of the role's names in use."""
    candidates = [
        item
        for item in choice
        if item.kind in ROLES[role].kinds
        and (role != 'image' or not any(f'/{part}' in f'/{item.name}' for part in DERIVED_IMAGES))
    ]
    for ending in ROLES[role].endings:
        matches = [item for item in candidates if f'/{item.name}'.endswith(f'/{ending}')]
        if len(matches) > 1 and role == 'camera_info' and 'image' in topics:
            matches = _beside(topics['image'], matches)
        if len(matches) > 1:
            names = ', '.join(item.name for item in matches)
            raise InputError(
                f'{bag.path}: {role} may be {names}; say which: --topics '
                f'{role}={matches[0].name}, or --namespace of the robot'
            )
        if matches:
            return matches[0]
    _refuse_wrong_kind(bag, role)
    return candidates[0] if role in ('image', 'camera_info') and len(candidates) == 1 else None


def _beside(image: BagTopic, infos: list[BagTopic], *, or_all: bool = True) -> list[BagTopic]:
    """Return the camera_info in the namespace of ``image``; if there is none, all or none."""
    space = image.name.removesuffix('/compressed').rpartition('/')[0]
    beside = [item for item in infos if item.name.rpartition('/')[0] == space]
    return beside or (infos if or_all else [])


def _refuse_wrong_kind(bag: Bag, role: str) -> None:
    """Raise InputError for a topic that has the right name but a type of no use."""
    ending, kinds = ROLES[role].endings[0], ROLES[role].kinds
    topic = bag.topics.get(f'/{ending}')
    if topic is not None and topic.kind not in kinds:
        raise InputError(
            f'{bag.path}: {topic.name} must be {" or ".join(kinds)}, got {topic.kind}; name the '
            f'topic that is: --topics {role}=NAME'
        )
