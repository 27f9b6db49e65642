"""What a managed node does in which state: inactive is silent, and loses nothing that counts."""

from lifecycles import go
import pytest
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import parameters, qos
from visual_servo_epipolar.nodes.startup import complaints


def words(heard: list[String]) -> list[str]:
    return [message.data for message in heard]


def test_a_node_is_active_at_once_unless_told_otherwise(bench, parrot) -> None:
    node = parrot(autostart_node=True)
    assert (node.state, node.calls) == ('active', ['configure', 'activate'])
    assert bench.call('parrot/talk').success


def test_a_node_that_is_left_to_others_says_what_to_do(bench, parrot) -> None:
    node = parrot()
    assert (node.state, node.calls) == ('unconfigured', [])
    expected = (
        'autostart_node is false: /parrot is unconfigured; '
        'call ros2 lifecycle set /parrot configure, then activate'
    )
    bench.until(lambda: bench.logged(expected), 'what to do in the log')


def test_services_answer_what_to_do(bench, parrot) -> None:
    node = parrot()
    answer = bench.call('parrot/talk')
    assert (answer.success, answer.message) == (
        False,
        '/parrot is unconfigured; call ros2 lifecycle set /parrot configure, then activate',
    )
    assert go(bench, node, 'configure') == 'inactive'
    answer = bench.call('parrot/talk')
    assert (answer.success, answer.message) == (
        False,
        '/parrot is inactive; call ros2 lifecycle set /parrot activate',
    )
    go(bench, node, 'activate')
    assert bench.call('parrot/talk').message == 'hello'


@pytest.mark.parametrize('way', [(), ('configure',), ('configure', 'activate')])
def test_what_is_marked_answers_in_every_state(bench, parrot, way) -> None:
    go(bench, parrot(), *way)
    assert bench.call('parrot/hush').message == 'silent'


def test_inactive_is_silent_and_deaf(bench, parrot) -> None:
    say, heard = bench.talk(String, 'said'), bench.listen(String, 'words')
    node = parrot()
    go(bench, node, 'configure')
    say(write.text('to nobody'))
    bench.settle()
    assert (node.heard, node.ticks, words(heard)) == ([], 0, [])
    go(bench, node, 'activate')
    say(write.text('hello'))
    bench.until(lambda: node.heard == ['hello'] and node.ticks > 0, 'an active node to hear')
    go(bench, node, 'deactivate')
    ticks = node.ticks
    say(write.text('to nobody'))
    bench.settle()
    assert (node.heard, node.ticks) == (['hello'], ticks)


def test_the_last_words_of_an_active_node_are_heard(bench, parrot) -> None:
    heard = bench.listen(String, 'words')
    node = parrot()
    go(bench, node, 'configure', 'activate', 'deactivate', 'cleanup')
    bench.settle()
    assert words(heard) == ['deactivate']


def test_what_is_latched_is_said_on_activation(bench, parrot) -> None:
    heard = bench.listen(String, 'mood', qos.LATCHED)
    node = parrot()
    go(bench, node, 'configure')
    bench.settle()
    assert words(heard) == []
    go(bench, node, 'activate')
    bench.until(lambda: words(heard) == ['activate'], 'what was said last')


def test_what_is_latched_is_heard_on_activation(bench, parrot) -> None:
    name = bench.talk(String, 'name', qos.LATCHED)
    node = parrot()
    go(bench, node, 'configure')
    for word in ('Polly', 'Coco'):
        name(write.text(word))
        bench.settle()
    assert node.heard == []
    go(bench, node, 'activate')
    bench.until(lambda: node.heard, 'its name')
    assert node.heard == ['Coco']  # the newest, as its depth says
    go(bench, node, 'deactivate', 'activate')
    assert node.heard == ['Coco']  # once


def test_a_node_that_is_configured_anew_hears_anew_what_is_latched(bench, parrot) -> None:
    name = bench.talk(String, 'name', qos.LATCHED)
    name(write.text('Polly'))
    node = parrot(autostart_node=True)
    bench.until(lambda: node.heard == ['Polly'], 'its name')
    go(bench, node, 'deactivate', 'cleanup', 'configure', 'activate')
    bench.until(lambda: node.heard == ['Polly', 'Polly'], 'its name again')


def test_what_was_latched_before_a_cleanup_is_forgotten(bench, parrot) -> None:
    name = bench.talk(String, 'name', qos.LATCHED)
    node = parrot()
    go(bench, node, 'configure')
    name(write.text('Polly'))
    bench.settle()
    go(bench, node, 'cleanup')
    name(write.text('Coco'))
    bench.settle()
    go(bench, node, 'configure', 'activate')
    bench.until(lambda: node.heard, 'its name')
    assert node.heard == ['Coco']


@pytest.mark.parametrize('early', [True, False])
def test_simulated_time_goes_on_while_a_node_is_inactive(bench, parrot, early) -> None:
    tick = bench.talk(Clock, '/clock', qos.CLOCK)
    node = parrot(use_sim_time=early)
    node.set_parameters([parameters.override('use_sim_time', True)])
    bench.until(lambda: any(item.topic_name == '/clock' for item in node.subscriptions), 'a clock')

    def came() -> bool:
        tick(write.clock(5_000_000_000))
        return bool(node.get_clock().now().nanoseconds == 5_000_000_000)

    bench.until(came, 'the time')


def test_what_others_take_care_of_outlives_a_cleanup(bench, parrot) -> None:
    node = parrot(autostart_node=True)
    complaints.watch(node)
    bench.call('parrot/talk')
    go(bench, node, 'deactivate', 'cleanup')
    assert len(list(node.timers)) == 1
