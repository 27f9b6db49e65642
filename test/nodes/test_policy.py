"""The SROS 2 policy lets each node do what it does, and an operator what the pages say."""

from pathlib import Path
import xml.etree.ElementTree as ElementTree

from bench import Bench
from node_process import node_class
import pytest

POLICY = Path(__file__).parents[2] / 'config' / 'sros2' / 'visual_servo.policy.xml'
# Nodes, with parameters that make them use more topics.
NODES = {
    'tracker_node': {'renew': True},
    'dock_node': {'serve_action': True},
    'servo_node': {'odometry': True, 'enable_timeout': 0.5},
    'route_node': {'enable_timeout': 0.5},
    'recorder_node': {},
}
OWN = ('reset', 'start', 'stop', 'repeat', 'cancel', 'capture_desired', 'set_parameters')


def allowed(node: str, part: str, how: str) -> set[str]:
    """Return the full names that the policy allows to ``node``: topics, services or actions."""
    (profile,) = ElementTree.parse(POLICY).iterfind(f".//profile[@node='{node}']")
    groups = profile.iterfind(f"{part}[@{how}='ALLOW']")
    texts = (item.text or '' for group in groups for item in group)
    return {text if text[:1] == '/' else f'/{text.replace("~", node)}' for text in texts}


@pytest.mark.parametrize('name', NODES)
def test_a_node_is_allowed_all_that_it_uses(name: str, bench: Bench, tmp_path: Path) -> None:
    values = NODES[name] | ({'bag': str(tmp_path / 'bag')} if name == 'recorder_node' else {})
    node = bench.start(node_class(name), **values)
    for part, how, used in (
        ('topics', 'publish', node.get_publisher_names_and_types_by_node),
        ('topics', 'subscribe', node.get_subscriber_names_and_types_by_node),
        ('services', 'reply', node.get_service_names_and_types_by_node),
        ('services', 'request', node.get_client_names_and_types_by_node),
    ):
        names = {each for each, _ in used(name, '/')}
        permitted = allowed(name, part, how)
        assert names <= permitted or '/*' in permitted, (how, names - permitted)


def test_only_the_operator_sets_off_and_sets_parameters() -> None:
    requests = allowed('operator', 'services', 'request')
    for node in NODES:
        assert f'/{node}/set_parameters' in requests
        others = {each for each in NODES if each != node}
        for other in others:
            asked = allowed(other, 'services', 'request')
            assert f'/{node}/set_parameters' not in asked
    replied = set().union(*(allowed(node, 'services', 'reply') for node in NODES))
    assert {each for each in replied if each.rpartition('/')[2] in OWN} <= requests
    assert allowed('operator', 'topics', 'publish').isdisjoint({'/cmd_vel', '/tracks'})
