"""Tracker and servo on a real robot's own camera and base; dock node and recorder if asked for."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction
from launch_ros.actions import Node

from visual_servo_epipolar.nodes.startup.launching import (
    argument,
    config,
    given,
    our_node,
    own,
    rig,
    UNSET_OR_BOOLEAN,
)


def generate_launch_description():
    """Return arguments and nodes; a parameter whose argument is empty is left to the files."""
    return LaunchDescription(
        [
            argument('namespace'),
            argument(
                'params_file', '', 'Parameters of your own, which win over config/robot.yaml'
            ),
            argument('rig'),
            argument('image'),
            argument('camera_info'),
            argument('cmd_vel'),
            argument(
                'odom',
                'odom',
                "Topic of the base's odometry: for the dock node, which takes metres from it, and "
                'for a servo with odometry: true',
            ),
            argument('joint_states', 'joint_states', 'Topic of the angles of a head'),
            argument('head_command', 'head/command', 'Topic on which a head takes its command'),
            argument('desired_image', otherwise='call tracker_node/capture_desired'),
            argument(
                'autostart',
                '',
                'true: the robot drives as soon as there are tracks, not on ~/start',
                UNSET_OR_BOOLEAN,
            ),
            argument('use_sim_time', source='a simulator'),
            argument('record'),
            argument(
                'dock',
                'none',
                'pose: a dock node publishes detected_dock_pose; serve: it serves the action '
                'dock_robot as well, which starts the servo',
                ('none', 'pose', 'serve'),
            ),
            argument(
                'lifecycle',
                'self',
                'What configures and activates: each node itself at the start, you by ros2 '
                'lifecycle, or the lifecycle manager of nav2, which is started for it',
                ('self', 'manual', 'nav2'),
            ),
            argument('sigterm_timeout'),
            OpaqueFunction(function=nodes),
        ]
    )


def nodes(context):
    """Return tracker and servo, and what is asked for of dock node, recorder and manager."""
    value = context.launch_configurations
    # The parameter that leaves the nodes to somebody else, if that is so.
    managed = [] if value['lifecycle'] == 'self' else [{'autostart_node': False}]
    files = [config('robot.yaml'), *rig(value['rig']), *own(value['params_file'])]
    tracker = our_node(
        value,
        'tracker_node',
        [*files, *given(value, desired_image=str), *managed],
        ['image_raw', 'camera_info'],
    )
    servo = our_node(
        value,
        'servo_node',
        [*files, *given(value, autostart=bool), *managed],
        ['camera_info', 'cmd_vel', 'odom', 'joint_states', 'head/command'],
    )
    # Files of both: robot.yaml tells what the dock node shares with the servo.
    dock = our_node(
        value,
        'dock_node',
        [
            config('dock_node.yaml'),
            *files,
            {'serve_action': value['dock'] == 'serve'},
            *managed,
        ],
        ['camera_info', 'odom', 'cmd_vel'],
    )
    recorder = our_node(
        value,
        'recorder_node',
        # No file of the servo's: its autostart is another.
        [config('recorder_node.yaml'), {'bag': value['record']}, *managed],
    )
    recorders = [recorder] if value['record'] else []
    docks = [] if value['dock'] == 'none' else [dock]
    # The servo starts after what it needs, and the dock node, which orders it about, after it.
    led = [*recorders, tracker, servo, *docks]
    return [*led, *manager(value)]


def manager(value):
    """Return the lifecycle manager of nav2 for what is launched, if it is asked for."""
    if value['lifecycle'] != 'nav2':
        return []
    recorded = ['recorder_node'] if value['record'] else []
    docked = [] if value['dock'] == 'none' else ['dock_node']
    parameters = {
        'autostart': True,
        'bond_timeout': 0.0,  # there is no bond for Python: it would wait for one in vain
        'node_names': [*recorded, 'tracker_node', 'servo_node', *docked],
    }
    return [
        Node(
            package='nav2_lifecycle_manager',
            executable='lifecycle_manager',
            name='lifecycle_manager_visual_servo',
            namespace=value['namespace'],
            parameters=[parameters, *given(value, use_sim_time=bool)],
            output='screen',
        )
    ]
