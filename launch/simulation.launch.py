"""The simulated robot: base and camera, tracker and servo; a recorder and RViz if asked for."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

PACKAGE = 'visual_servo_epipolar'
# The topics of config/visual_servo.rviz that are the robot's own: RViz looks in its namespace.
SHOWN = [
    'odom',
    'ground_truth',
    'overlay/image_raw',
    'camera_node/frames',
    'servo_node/markers',
    'tracker_node/desired/image_raw',
]


def generate_launch_description():
    """Return arguments and nodes; a parameter whose argument is empty is left to the files."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'namespace', default_value='', description='Namespace of the nodes, as robot1'
            ),
            DeclareLaunchArgument(
                'frame_prefix',
                default_value='',
                description='Put before the frames of the robot, as robot1/; they share the world',
            ),
            DeclareLaunchArgument(
                'params_file',
                default_value='',
                description='Parameters of tracker and servo, as in config/robot.yaml',
            ),
            DeclareLaunchArgument(
                'world_file',
                default_value='',
                description='Parameters of the simulated base and camera, likewise',
            ),
            DeclareLaunchArgument(
                'image', default_value='image_raw', description='Topic of the images'
            ),
            DeclareLaunchArgument(
                'camera_info', default_value='camera_info', description='Topic of the calibration'
            ),
            DeclareLaunchArgument(
                'cmd_vel', default_value='cmd_vel', description='Topic of the commands'
            ),
            DeclareLaunchArgument(
                'start',
                default_value='',
                description='x, y [m], heading error [deg] of the start: "[0.5, -3.0, 5.0]"',
            ),
            DeclareLaunchArgument(
                'seed', default_value='', description='Seed of the noise of wheels and camera'
            ),
            DeclareLaunchArgument(
                'camera_size',
                default_value='1280x1024',
                choices=['1280x1024', '640x480'],
                description='Size of the images [px]; the small one is a quarter of the work',
            ),
            DeclareLaunchArgument(
                'desired_image',
                default_value='',
                description='File of the photograph; empty: the camera takes it at the goal',
            ),
            DeclareLaunchArgument(
                'autostart',
                default_value='',
                choices=['', 'true', 'false'],
                description='false: the servo waits for its service ~/start',
            ),
            DeclareLaunchArgument(
                'use_sim_time',
                default_value='',
                choices=['', 'true', 'false'],
                description='true: time comes from /clock, which somebody else publishes',
            ),
            DeclareLaunchArgument(
                'record', default_value='', description='Folder of a new bag; empty: no recorder'
            ),
            DeclareLaunchArgument(
                'rviz',
                default_value='false',
                choices=['true', 'false'],
                description='true: open RViz, which must be installed',
            ),
            DeclareLaunchArgument(
                'sigterm_timeout',
                default_value='30',
                description='Time to end after Ctrl-C [s]: a recorder completes its bag in it',
            ),
            OpaqueFunction(function=world),
            OpaqueFunction(function=controller),
            OpaqueFunction(function=onlookers),
        ]
    )


def world(context):
    """Return the simulated base and its camera, which takes the photograph at the goal."""
    value = context.launch_configurations
    camera_files = [config('camera_node.yaml')]
    if value['camera_size'] == '640x480':
        camera_files.append(config('camera_node_640x480.yaml'))
    return [
        Node(
            package=PACKAGE,
            executable='unicycle_node',
            namespace=value['namespace'],
            parameters=[
                config('unicycle_node.yaml'),
                *own(value['world_file']),
                *([{'start': numbers(value['start'])}] if value['start'] else []),
                *given(value, seed=int, frame_prefix=str, use_sim_time=bool),
            ],
            remappings=[('cmd_vel', value['cmd_vel'])],
            output='screen',
        ),
        Node(
            package=PACKAGE,
            executable='camera_node',
            namespace=value['namespace'],
            parameters=[
                *camera_files,
                *own(value['world_file']),
                *given(value, seed=int, frame_prefix=str, use_sim_time=bool),
            ],
            remappings=[('image_raw', value['image']), ('camera_info', value['camera_info'])],
            output='screen',
        ),
    ]


def controller(context):
    """Return tracker and servo, as they run on a real robot."""
    value = context.launch_configurations
    prefix = value['frame_prefix']
    return [
        Node(
            package=PACKAGE,
            executable='tracker_node',
            namespace=value['namespace'],
            parameters=[
                config('tracker_node.yaml'),
                *own(value['params_file']),
                *given(value, desired_image=str, use_sim_time=bool),
            ],
            remappings=[('image_raw', value['image']), ('camera_info', value['camera_info'])],
            output='screen',
        ),
        Node(
            package=PACKAGE,
            executable='servo_node',
            namespace=value['namespace'],
            parameters=[
                config('servo_node.yaml'),
                *own(value['params_file']),
                *([{'base_frame': f'{prefix}base_link'}] if prefix else []),
                *given(value, autostart=bool, use_sim_time=bool),
            ],
            remappings=[('camera_info', value['camera_info']), ('cmd_vel', value['cmd_vel'])],
            output='screen',
        ),
    ]


def onlookers(context):
    """Return the recorder and RViz, if they are asked for."""
    value = context.launch_configurations
    namespace = value['namespace'].strip('/')
    # In a namespace: of this robot alone, what robots share, and what was sent elsewhere.
    topics = [f'/{namespace}/*', '/diagnostics', '/tf*', '/clock']
    topics += [
        value[name] for name in ('image', 'camera_info', 'cmd_vel') if value[name][0] == '/'
    ]
    recorder = Node(
        package=PACKAGE,
        executable='recorder_node',
        namespace=value['namespace'],
        parameters=[
            config('recorder_node.yaml'),
            *([{'topics': topics}] if namespace else []),
            {'bag': value['record']},
            *given(value, use_sim_time=bool),
        ],
        output='screen',
    )
    rviz = Node(
        package='rviz2',
        executable='rviz2',
        namespace=value['namespace'],
        arguments=['-d', config('visual_servo.rviz'), '-f', f'{value["frame_prefix"]}odom'],
        parameters=given(value, use_sim_time=bool),
        remappings=[
            ('/image_raw', value['image']),
            ('/camera_info', value['camera_info']),
            *((f'/{topic}', topic) for topic in SHOWN),
        ],
    )
    return [*([recorder] if value['record'] else []), *([rviz] if value['rviz'] == 'true' else [])]


def config(name):
    """Return the path of a file in this package's config folder."""
    return PathJoinSubstitution([FindPackageShare(PACKAGE), 'config', name])


def own(file):
    """Return the user's parameter file, if there is one."""
    if file and not Path(file).expanduser().is_file():  # launch would go on without it
        raise RuntimeError(f'there is no parameter file {file}; give the path of one')
    return [str(Path(file).expanduser())] if file else []


def numbers(text):
    """Return the numbers in a text such as [1.0, -3.5, 8]."""
    try:
        x, y, heading = (float(word) for word in text.strip('[] ').replace(',', ' ').split())
        return [x, y, heading]
    except ValueError:
        raise RuntimeError(
            f'start must be three numbers, x [m], y [m], heading error [deg], got {text!r}; '
            'write start:="[0.5, -3.0, 5.0]"'
        ) from None


def given(value, **kinds):
    """Return the parameters, of these types, whose argument of the same name is not empty."""
    return [
        {name: ParameterValue(LaunchConfiguration(name), value_type=kind)}
        for name, kind in kinds.items()
        if value[name]
    ]
