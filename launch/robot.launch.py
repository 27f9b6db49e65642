"""Tracker and servo on a real robot's own camera and base; dock node and recorder if asked for."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'visual_servo_epipolar'


def generate_launch_description():
    """Return arguments and nodes; a parameter whose argument is empty is left to the files."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'namespace', default_value='', description='Namespace of the nodes, as robot1'
            ),
            DeclareLaunchArgument(
                'params_file',
                default_value='',
                description='Parameters of your own, which win over config/robot.yaml',
            ),
            DeclareLaunchArgument(
                'image',
                default_value='image_raw',
                description="Topic of the camera's images, as /camera/image_raw",
            ),
            DeclareLaunchArgument(
                'camera_info',
                default_value='camera_info',
                description='Topic of its calibration, as /camera/camera_info',
            ),
            DeclareLaunchArgument(
                'cmd_vel',
                default_value='cmd_vel',
                description='Topic on which the base takes velocity commands',
            ),
            DeclareLaunchArgument(
                'odom',
                default_value='odom',
                description="Topic of the base's odometry: for the dock node, which takes metres "
                'from it, and for a servo with odometry: true',
            ),
            DeclareLaunchArgument(
                'desired_image',
                default_value='',
                description='File of the photograph; empty: call tracker_node/capture_desired',
            ),
            DeclareLaunchArgument(
                'autostart',
                default_value='',
                choices=['', 'true', 'false'],
                description='true: the robot drives as soon as there are tracks, not on ~/start',
            ),
            DeclareLaunchArgument(
                'use_sim_time',
                default_value='',
                choices=['', 'true', 'false'],
                description='true: time comes from /clock, which a simulator publishes',
            ),
            DeclareLaunchArgument(
                'record', default_value='', description='Folder of a new bag; empty: no recorder'
            ),
            DeclareLaunchArgument(
                'dock',
                default_value='none',
                choices=['none', 'pose', 'serve'],
                description='pose: a dock node publishes detected_dock_pose; serve: it serves the '
                'action dock_robot as well, which starts the servo',
            ),
            DeclareLaunchArgument(
                'lifecycle',
                default_value='self',
                choices=['self', 'manual', 'nav2'],
                description='Who configures and activates: each node itself at the start, you by '
                'ros2 lifecycle, or the lifecycle manager of nav2, which is started for it',
            ),
            DeclareLaunchArgument(
                'sigterm_timeout',
                default_value='30',
                description='Time to end after Ctrl-C [s]: a recorder completes its bag in it',
            ),
            OpaqueFunction(function=controller),
            OpaqueFunction(function=dock),
            OpaqueFunction(function=recorder),
            OpaqueFunction(function=manager),
        ]
    )


def controller(context):
    """Return tracker and servo."""
    value = context.launch_configurations
    return [
        Node(
            package=PACKAGE,
            executable='tracker_node',
            namespace=value['namespace'],
            parameters=[
                config('robot.yaml'),
                *own(value['params_file']),
                *given(value, desired_image=str, use_sim_time=bool),
                *managed(value),
            ],
            remappings=[('image_raw', value['image']), ('camera_info', value['camera_info'])],
            output='screen',
        ),
        Node(
            package=PACKAGE,
            executable='servo_node',
            namespace=value['namespace'],
            parameters=[
                config('robot.yaml'),
                *own(value['params_file']),
                *given(value, autostart=bool, use_sim_time=bool),
                *managed(value),
            ],
            remappings=[
                ('camera_info', value['camera_info']),
                ('cmd_vel', value['cmd_vel']),
                ('odom', value['odom']),
            ],
            output='screen',
        ),
    ]


def dock(context):
    """Return the dock node, if it is asked for; robot.yaml tells what it shares with the servo."""
    value = context.launch_configurations
    node = Node(
        package=PACKAGE,
        executable='dock_node',
        namespace=value['namespace'],
        parameters=[
            config('dock_node.yaml'),
            config('robot.yaml'),
            *own(value['params_file']),
            {'serve_action': value['dock'] == 'serve'},
            *given(value, use_sim_time=bool),
            *managed(value),
        ],
        remappings=[
            ('camera_info', value['camera_info']),
            ('odom', value['odom']),
            ('cmd_vel', value['cmd_vel']),
        ],
        output='screen',
    )
    return [] if value['dock'] == 'none' else [node]


def recorder(context):
    """Return the recorder, if a bag is asked for."""
    value = context.launch_configurations
    node = Node(
        package=PACKAGE,
        executable='recorder_node',
        namespace=value['namespace'],
        parameters=[
            config('recorder_node.yaml'),  # no file of the servo's: its autostart is another
            {'bag': value['record']},
            *given(value, use_sim_time=bool),
            *managed(value),
        ],
        output='screen',
    )
    return [node] if value['record'] else []


def manager(context):
    """
    Return the lifecycle manager of nav2, if it is asked for.

    The servo starts after what it needs, and the dock node, which orders it about, after it.
    """
    value = context.launch_configurations
    recorded = ['recorder_node'] if value['record'] else []
    docked = [] if value['dock'] == 'none' else ['dock_node']
    node = Node(
        package='nav2_lifecycle_manager',
        executable='lifecycle_manager',
        name='lifecycle_manager_visual_servo',
        namespace=value['namespace'],
        parameters=[
            {
                'autostart': True,
                'bond_timeout': 0.0,  # there is no bond for Python: it would wait for one in vain
                'node_names': [*recorded, 'tracker_node', 'servo_node', *docked],
            },
            *given(value, use_sim_time=bool),
        ],
        output='screen',
    )
    return [node] if value['lifecycle'] == 'nav2' else []


def managed(value):
    """Return the parameter that leaves the nodes to somebody else, if that is so."""
    return [] if value['lifecycle'] == 'self' else [{'autostart_node': False}]


def config(name):
    """Return the path of a file in this package's config folder."""
    return PathJoinSubstitution([FindPackageShare(PACKAGE), 'config', name])


def own(file):
    """Return the user's parameter file, if there is one."""
    if file and not Path(file).expanduser().is_file():  # launch would go on without it
        raise RuntimeError(f'there is no parameter file {file}; give the path of one')
    return [str(Path(file).expanduser())] if file else []


def given(value, **kinds):
    """Return the parameters, of these types, whose argument of the same name is not empty."""
    return [
        {name: ParameterValue(LaunchConfiguration(name), value_type=kind)}
        for name, kind in kinds.items()
        if value[name]
    ]
