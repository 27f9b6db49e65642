"""The simulated robot: base and camera, tracker and servo; a recorder and RViz if asked for."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from visual_servo_epipolar.nodes.startup.launching import (
    argument,
    config,
    given,
    numbers,
    our_node,
    own,
    own_tf,
    rig,
    UNSET_OR_BOOLEAN,
)

# The topics of config/visual_servo.rviz that are the robot's own: RViz looks in its namespace.
SHOWN = [
    'odom',
    'ground_truth',
    'overlay/image_raw',
    'servo_node/markers',
    'tracker_node/desired/image_raw',
]


def generate_launch_description():
    """Return arguments and nodes; a parameter whose argument is empty is left to the files."""
    return LaunchDescription(
        [
            argument('namespace'),
            argument(
                'params_file', '', 'Parameters of tracker and servo, as in config/robot.yaml'
            ),
            argument('world_file', '', 'Parameters of the simulated base and camera, likewise'),
            argument('rig'),
            argument('image', 'image_raw', 'Topic of the images'),
            argument('camera_info', 'camera_info', 'Topic of the calibration'),
            argument('cmd_vel', 'cmd_vel', 'Topic of the commands'),
            argument(
                'start', '', 'x, y [m], heading error [deg] of the start: "[0.5, -3.0, 5.0]"'
            ),
            argument('seed', '', 'Seed of the noise of wheels and camera'),
            argument(
                'camera_size',
                '1280x1024',
                'Size of the images [px]; the small one is a quarter of the work',
                ('1280x1024', '640x480'),
            ),
            argument('desired_image', otherwise='the camera takes it at the goal'),
            argument(
                'autostart', '', 'false: the servo waits for its service ~/start', UNSET_OR_BOOLEAN
            ),
            argument('use_sim_time', source='another program'),
            argument('record'),
            argument(
                'rviz',
                'false',
                'true: open RViz, which must be installed',
                ('true', 'false'),
            ),
            argument('sigterm_timeout'),
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
    files, more = [*rig(value['rig']), *own(value['world_file'])], given(value, seed=int)
    start = [{'start': numbers(value['start'])}] if value['start'] else []
    base = [config('unicycle_node.yaml'), *files, *start, *more]
    return [
        our_node(value, 'unicycle_node', base, ['cmd_vel'], ['/tf']),
        our_node(
            value,
            'camera_node',
            [*camera_files, *files, *more],
            ['image_raw', 'camera_info'],
            ['/tf_static'],
        ),
    ]


def controller(context):
    """Return tracker and servo, as they run on a real robot."""
    value = context.launch_configurations
    files = [*rig(value['rig']), *own(value['params_file'])]
    tracker = [config('tracker_node.yaml'), *files, *given(value, desired_image=str)]
    servo = [config('servo_node.yaml'), *files, *given(value, autostart=bool)]
    return [
        our_node(value, 'tracker_node', tracker, ['image_raw', 'camera_info']),
        our_node(value, 'servo_node', servo, ['camera_info', 'cmd_vel'], ['/tf_static']),
    ]


def onlookers(context):
    """Return the recorder and RViz, if they are asked for."""
    value = context.launch_configurations
    namespace = value['namespace'].strip('/')
    # In a namespace: of this robot alone, what robots share, and what was sent elsewhere.
    topics = [f'/{namespace}/*', '/diagnostics', '/clock']
    topics += [
        value[name] for name in ('image', 'camera_info', 'cmd_vel') if value[name][0] == '/'
    ]
    selected = [{'topics': topics}] if namespace else []
    recorder = our_node(
        value,
        'recorder_node',
        [config('recorder_node.yaml'), *selected, {'bag': value['record']}],
    )
    rviz = Node(
        package='rviz2',
        executable='rviz2',
        namespace=value['namespace'],
        arguments=['-d', config('visual_servo.rviz')],
        parameters=given(value, use_sim_time=bool),
        remappings=[
            ('/image_raw', value['image']),
            ('/camera_info', value['camera_info']),
            *((f'/{topic}', topic) for topic in SHOWN),
            *own_tf(value, '/tf', '/tf_static'),
        ],
    )
    return [*([recorder] if value['record'] else []), *([rviz] if value['rviz'] == 'true' else [])]
