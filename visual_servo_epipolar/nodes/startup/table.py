"""Table of the nodes: what each does, and where its settings are."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
import re

from visual_servo_epipolar.core.settings import names_of, parameters_of, Settings
from visual_servo_epipolar.files import PACKAGE


@dataclass(frozen=True, slots=True)
class NodeRow:
    """A node in words; ``settings`` are classes by module and name, imported when asked for."""

    does: str
    settings: tuple[str, ...]


# Nodes that run on a robot come first: looking up a name of theirs imports no simulation.
NODES: Mapping[str, NodeRow] = {
    'servo_node': NodeRow(
        does='Drives the robot to the pose of the photograph: features in, velocities out.',
        settings=('nodes.startup.settings:ServoNodeSettings', 'core.servo.settings:ServoSettings'),
    ),
    'tracker_node': NodeRow(
        does='Finds the features of the photograph in each image.',
        settings=(
            'nodes.startup.settings:TrackerNodeSettings',
            'core.tracking.settings:TrackerSettings',
        ),
    ),
    'dock_node': NodeRow(
        does='Says where the photograph was taken, in metres, and docks there on request.',
        settings=(
            'nodes.startup.settings:DockNodeSettings',
            'core.docking.task:DockTaskSettings',
            'core.docking.pose:DockPoseSettings',
        ),
    ),
    'route_node': NodeRow(
        does='Records a way by photographs, and repeats it: images in, velocities out.',
        settings=(
            'nodes.startup.settings:RouteNodeSettings',
            'core.servo.settings:StationSettings',
            'core.routes.settings:FollowSettings',
            'core.routes.settings:TeachSettings',
        ),
    ),
    'unicycle_node': NodeRow(
        does='Simulates the base: a Pioneer 3-DX, or a car.',
        settings=(
            'nodes.startup.settings:UnicycleSettings',
            'simulation.bases:AckermannSettings',
        ),
    ),
    'camera_node': NodeRow(
        does='Simulates the camera of the robot in a textured room.',
        settings=(
            'simulation.cameras:CameraSettings',
            'simulation.cameras:HeadSettings',
            'nodes.startup.settings:CameraRig',
            'simulation.disturbances:DisturbanceSettings',
            'simulation.light:LightSettings',
        ),
    ),
    'recorder_node': NodeRow(
        does='Records topics into a rosbag2 folder.',
        settings=(
            'nodes.startup.settings:RecorderNodeSettings',
            'bags.recording.settings:RecordSettings',
        ),
    ),
}


def settings_of(*nodes: str) -> Iterator[type[Settings]]:
    """Yield the classes whose fields are the parameters of ``nodes``, in their order."""
    for place in (place for node in nodes for place in NODES[node].settings):
        module, _, name = place.partition(':')
        yield getattr(import_module(f'{PACKAGE}.{module}'), name)


def name_of(kind: type) -> str:
    """Return the name of a node by its class: servo_node of a ServoNode."""
    return re.sub(r'(?<=[a-z])(?=[A-Z])', '_', kind.__name__).lower()


def owner_of(parameter: str) -> str:
    """Return the first node that has a parameter, of today or of an earlier version; or ''."""
    owners = [node for node in NODES if parameter in parameter_names(node)]
    return next(iter(owners or (node for node in NODES if parameter in accepted_names(node))), '')


def parameter_names(node: str) -> set[str]:
    """Return the parameters that a node has today."""
    return {item.name for kind in settings_of(node) for item in parameters_of(kind)}


def accepted_names(*nodes: str) -> set[str]:
    """Return the parameters of ``nodes``, with the names of earlier versions."""
    return {name for kind in settings_of(*nodes) for name in names_of(kind)}
