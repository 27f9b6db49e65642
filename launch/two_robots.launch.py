"""Two simulated robots, each in a namespace of its own; neither sees the other."""

from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    GroupAction,
    IncludeLaunchDescription,
    OpaqueFunction,
)
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import PathJoinSubstitution
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'visual_servo_epipolar'
PASSED_ON = ['params_file', 'world_file', 'camera_size', 'autostart', 'rviz']


def generate_launch_description():
    """Return the arguments, and the simulation twice."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'start1',
                default_value='[1.0, -3.5, 8.0]',
                description='Start of robot1: x, y [m], heading error [deg]',
            ),
            DeclareLaunchArgument(
                'start2',
                default_value='[-1.2, -3.0, -6.0]',
                description='Start of robot2, likewise',
            ),
            DeclareLaunchArgument('seed1', default_value='1', description='Seed of robot1'),
            DeclareLaunchArgument('seed2', default_value='2', description='Seed of robot2'),
            DeclareLaunchArgument(
                'params_file',
                default_value='',
                description='Parameters of tracker and servo; keyed /robot1/**: of that robot',
            ),
            DeclareLaunchArgument(
                'world_file',
                default_value='',
                description='Parameters of the simulated bases and cameras, likewise',
            ),
            DeclareLaunchArgument(
                'camera_size',
                default_value='640x480',
                choices=['1280x1024', '640x480'],
                description='Size of the images [px]',
            ),
            DeclareLaunchArgument(
                'autostart',
                default_value='',
                choices=['', 'true', 'false'],
                description='false: each servo waits for its service ~/start',
            ),
            DeclareLaunchArgument(
                'record',
                default_value='',
                description='Folder for the bags robot1 and robot2; empty: no recorder',
            ),
            DeclareLaunchArgument(
                'rviz',
                default_value='false',
                choices=['true', 'false'],
                description='true: open RViz for each robot',
            ),
            DeclareLaunchArgument(
                'sigterm_timeout',
                default_value='30',
                description='Time to end after Ctrl-C [s]: a recorder completes its bag in it',
            ),
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
