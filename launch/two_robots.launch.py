"""Two simulated robots, each in a namespace of its own; neither sees the other."""

from launch import LaunchDescription
from launch.actions import GroupAction, IncludeLaunchDescription, OpaqueFunction
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

from visual_servo_epipolar.nodes.startup.launching import argument, PACKAGE, UNSET_OR_BOOLEAN

PASSED_ON = ['params_file', 'world_file', 'camera_size', 'autostart', 'rviz']


def generate_launch_description():
    """Return the arguments, and the simulation twice."""
    return LaunchDescription(
        [
            argument(
                'start1', '[1.0, -3.5, 8.0]', 'Start of robot1: x, y [m], heading error [deg]'
            ),
            argument('start2', '[-1.2, -3.0, -6.0]', 'Start of robot2, likewise'),
            argument('seed1', '1', 'Seed of robot1'),
            argument('seed2', '2', 'Seed of robot2'),
            argument(
                'params_file',
                '',
                'Parameters of tracker and servo; keyed /robot1/**: of that robot',
            ),
            argument('world_file', '', 'Parameters of the simulated bases and cameras, likewise'),
            argument(
                'camera_size', '640x480', 'Size of the images [px]', ('1280x1024', '640x480')
            ),
            argument(
                'autostart',
                '',
                'false: each servo waits for its service ~/start',
                UNSET_OR_BOOLEAN,
            ),
            argument('record', '', 'Folder for the bags robot1 and robot2; empty: no recorder'),
            argument('rviz', 'false', 'true: open RViz for each robot', ('true', 'false')),
            argument('sigterm_timeout'),
            OpaqueFunction(function=robots),
        ]
    )


def robots(context):
    """Return both robots; a group keeps the arguments of the one from the other."""
    value = context.launch_configurations
    simulation = PathJoinSubstitution(
        [FindPackageShare(PACKAGE), 'launch', 'simulation.launch.py']
    )
    return [
        GroupAction(
            [
                IncludeLaunchDescription(
                    PythonLaunchDescriptionSource(simulation),
                    launch_arguments={
                        'namespace': f'robot{number}',
                        'frame_prefix': f'robot{number}/',
                        'start': value[f'start{number}'],
                        'seed': value[f'seed{number}'],
                        'record': value['record'] and f'{value["record"]}/robot{number}',
                        **{name: value[name] for name in PASSED_ON},
                    }.items(),
                )
            ]
        )
        for number in (1, 2)
    ]
