"""The route node on a robot's own camera and base, or on the simulated ones in a storey."""

from launch import LaunchDescription
from launch.actions import OpaqueFunction

from visual_servo_epipolar.nodes.startup.launching import (
    argument,
    config,
    given,
    numbers,
    our_node,
    own,
    UNSET_OR_BOOLEAN,
)


def generate_launch_description():
    """Return arguments and nodes; a parameter whose argument is empty is left to the files."""
    return LaunchDescription(
        [
            argument('namespace'),
            argument(
                'params_file', '', 'Parameters of your own, which win over config/route_node.yaml'
            ),
            argument(
                'route', '', 'Folder of the route: repeated, or written where a way is recorded'
            ),
            argument('image'),
            argument('camera_info'),
            argument('cmd_vel'),
            argument('odom', 'odom', "Topic of the base's odometry, for metres of a new way"),
            argument(
                'autostart',
                '',
                'true: it repeats the route at once, not on ~/repeat',
                UNSET_OR_BOOLEAN,
            ),
            argument(
                'simulate',
                'false',
                'true: start base and camera as well, simulated in a storey (config/storey.yaml)',
                ('true', 'false'),
            ),
            argument(
                'start', '', 'Simulated start: x, y [m], heading from +y [deg]: "[3.1, -5.0, 5.0]"'
            ),
            argument('use_sim_time', source='a simulator'),
            argument('record'),
            argument('sigterm_timeout'),
            OpaqueFunction(function=nodes),
        ]
    )


def nodes(context):
    """Return the route node, and what is asked for of recorder, simulated base and camera."""
    value = context.launch_configurations
    route = our_node(
        value,
        'route_node',
        [
            config('route_node.yaml'),
            *own(value['params_file']),
            *given(value, route=str, autostart=bool),
        ],
        ['image_raw', 'camera_info', 'cmd_vel', 'odom'],
    )
    recorder = our_node(
        value, 'recorder_node', [config('recorder_node.yaml'), {'bag': value['record']}]
    )
    start = [{'start': numbers(value['start'])}] if value['start'] else []
    base = our_node(
        value,
        'unicycle_node',
        [config('unicycle_node.yaml'), config('storey.yaml'), *start],
        ['cmd_vel', 'odom'],
    )
    camera = our_node(
        value,
        'camera_node',
        [config('camera_node.yaml'), config('storey.yaml')],
        ['image_raw', 'camera_info'],
    )
    world = [base, camera] if value['simulate'] == 'true' else []
    return [*([recorder] if value['record'] else []), *world, route]
