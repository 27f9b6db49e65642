"""What the launch files share: their arguments, our nodes with their files, and parameters."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from visual_servo_epipolar.core.settings import hint
from visual_servo_epipolar.files import config_names, PACKAGE

UNSET_OR_BOOLEAN = ('', 'true', 'false')
# Arguments that mean the same in several launch files: default, description, choices.
SHARED: Mapping[str, tuple[Any, ...]] = {
    'namespace': ('', 'Namespace of the nodes, as robot1'),
    'image': ('image_raw', "Topic of the camera's images, as /camera/image_raw"),
    'camera_info': ('camera_info', 'Topic of its calibration, as /camera/camera_info'),
    'cmd_vel': ('cmd_vel', 'Topic on which the base takes velocity commands'),
    'desired_image': ('', 'File of the photograph; empty: {otherwise}'),
    'use_sim_time': ('', 'true: time is the /clock of {source}', UNSET_OR_BOOLEAN),
    'rig': ('', 'Rig: a parameter file of camera, head and base, or a name, as panorama'),
    'record': ('', 'Folder of a new bag; empty: no recorder'),
    'sigterm_timeout': (
        '30',
        'Time to end after Ctrl-C [s]: a recorder completes its bag in it',
    ),
}
# The argument that names the topic of a name in the nodes, where that is another name.
TOPICS = {'image_raw': 'image', 'head/command': 'head_command'}


def argument(
    name: str, default: str = '', description: str = '', choices: Sequence[str] = (), **words: str
) -> DeclareLaunchArgument:
    """Return an argument; one that is SHARED needs its name alone, and the words it leaves out."""
    if not description:
        default, description, *rest = SHARED[name]
        description, choices = description.format(**words), rest[0] if rest else ()
    options = {'choices': list(choices)} if choices else {}
    return DeclareLaunchArgument(name, default_value=default, description=description, **options)


def our_node(
    value: Mapping[str, str],
    executable: str,
    parameters: Sequence[Any],
    topics: Sequence[str] = (),
    frames: Sequence[str] = (),
) -> Node:
    """Return a node of this package, ``topics`` remapped as arguments say; ``frames`` are tf's."""
    return Node(
        package=PACKAGE,
        executable=executable,
        namespace=value['namespace'],
        parameters=[*parameters, *given(value, use_sim_time=bool)],
        remappings=[
            *((topic, value[TOPICS.get(topic, topic)]) for topic in topics),
            *own_tf(value, *frames),
        ],
        output='screen',
    )


def own_tf(value: Mapping[str, str], *topics: str) -> list[tuple[str, str]]:
    """Return remappings by which robots in namespaces have a tree of frames each, as in Nav2."""
    return [(topic, topic[1:]) for topic in topics] if value['namespace'] else []


def config(*names: str) -> PathJoinSubstitution:
    """Return the path of a file in this package's config folder."""
    return PathJoinSubstitution([FindPackageShare(PACKAGE), 'config', *names])


def rig(name: str) -> list[Any]:
    """Return the parameter file of a rig: the user's, or ours of that ``name``; none of ''."""
    if not name or name.endswith('.yaml'):
        return list(own(name))
    names = config_names('rigs')
    if names and name not in names:
        raise RuntimeError(
            f'rig must be a parameter file or one of {", ".join(names)}, got {name!r}; '
            f'{hint([name], names)}'
        )
    return [config('rigs', f'{name}.yaml')]


def own(file: str) -> list[str]:
    """Return the user's parameter file, if there is one."""
    path = Path(file).expanduser()
    if file and not path.is_file():  # launch would go on without it
        raise RuntimeError(f'there is no parameter file {file}; give the path of one')
    return [str(path)] if file else []


def given(value: Mapping[str, str], **kinds: type) -> list[dict[str, ParameterValue]]:
    """Return the parameters, of these types, whose argument of the same name is not empty."""
    return [
        {name: ParameterValue(LaunchConfiguration(name), value_type=kind)}
        for name, kind in kinds.items()
        if value[name]
    ]


def numbers(text: str) -> list[float]:
    """Return the numbers of a start such as [1.0, -3.5, 8]."""
    try:
        x, y, heading = (float(word) for word in text.strip('[] ').replace(',', ' ').split())
        return [x, y, heading]
    except ValueError:
        raise RuntimeError(
            f'start must be three numbers, x [m], y [m], heading error [deg], got {text!r}; '
            'write start:="[0.5, -3.0, 5.0]"'
        ) from None
