"""Random transitions: no death, no stuck state, not a word unless active."""

import os
import random

from lifecycles import asked, change, drawn, entities, go, LABELS, TRANSITIONS, wanted
import pytest
from std_msgs.msg import String
from std_srvs.srv import Trigger

from visual_servo_epipolar.messages import write

MISTAKES = (OSError('a refusal'), KeyError('a mistake'))
# `make faults` asks for 10000.
REQUESTS, OVER_THE_WIRE = int(os.environ.get('LIFECYCLE_REQUESTS', '2000')), 300


class Campaign:
    """A node that is led about, and what it says; a new one after each end."""

    def __init__(self, bench, parrot) -> None:
        self.bench, self.parrot, self.ends = bench, parrot, 0
        self.node = parrot()
        self.before = entities(self.node)

    def renew(self) -> None:
        if self.node.state == 'finalized':
            self.ends += 1
            self.bench.nodes.remove(self.node)
            self.bench.executor.remove_node(self.node)
            self.node.destroy_node()
            self.node = self.parrot()

    def check(self) -> None:
        """Hold all that the node may do against its state."""
        node = self.node
        active = node.state == 'active'
        heard, ticks = len(node.heard), node.ticks
        for item in node.subscriptions:
            if item.topic_name == '/said':
                item.callback(write.text('psst'))
        for timer in node.timers:
            timer.callback()
        (talk,) = (item for item in node.services if item.srv_name.endswith('/talk'))
        answer = talk.callback(Trigger.Request(), Trigger.Response())
        assert answer.success == active
        assert (len(node.heard) - heard, node.ticks - ticks) == (active, active)
        if node.state in ('unconfigured', 'finalized'):
            assert entities(node) == self.before
        else:
            assert node.words.is_activated == active


def test_requests_by_id_and_label(bench, parrot) -> None:
    campaign, chance = Campaign(bench, parrot), random.Random(0)
    for _ in range(REQUESTS):
        node, (number, label) = campaign.node, drawn(chance)
        expected = wanted(node.state, number, label)
        changed = expected != node.state
        response = node._service_change_state.srv_type.Response()
        answer = node._service_change_state.callback(asked(number, label), response)
        assert (answer.success, node.state) == (changed, expected), (number, label)
        campaign.check()
        campaign.renew()
    assert campaign.ends >= REQUESTS // 500


def test_requests_over_the_wire_to_a_node_that_fails_now_and_then(bench, parrot) -> None:
    heard = bench.listen(String, 'words')
    campaign, chance = Campaign(bench, parrot), random.Random(1)
    for _ in range(OVER_THE_WIRE):
        node, state = campaign.node, campaign.node.state
        part = chance.choice(LABELS)
        node.fails = {part: chance.choice(MISTAKES)} if chance.random() < 0.3 else {}
        heard.clear()
        change(bench, node, *drawn(chance))
        assert node.state in TRANSITIONS, 'stuck'
        if 'active' not in (state, node.state):
            bench.executor.spin_once(timeout_sec=0.0)
            assert not heard, (state, node.state)
        node.fails = {}
        campaign.check()
        campaign.renew()
    bench.settle()


@pytest.mark.parametrize('way', [(), ('configure',), ('configure', 'activate')])
def test_the_end_comes_from_every_state_and_once(bench, parrot, way) -> None:
    node = parrot()
    before = entities(node)
    go(bench, node, *way)
    assert change(bench, node, label='shutdown')
    assert (node.state, entities(node)) == ('finalized', before)
    assert not change(bench, node, label='shutdown')
    assert not change(bench, node, 1)
