"""The traps of rclpy's lifecycle nodes: each is closed."""

from functools import partial

from lifecycles import assert_cycles_leave_nothing, assert_gone_at_once, change, entities, go, IDS
import pytest

from visual_servo_epipolar.nodes.lifecycle.managed_node import ManagedNode


@pytest.mark.parametrize('number', [IDS['activate'], IDS['configure'], 5, 10, 99, 255])
def test_an_impossible_transition_by_id_is_refused_and_the_node_lives_on(
    bench, parrot, number
) -> None:
    node = parrot(autostart_node=True)
    assert not change(bench, node, number)
    assert node.state == 'active'
    expected = f'/parrot is active: there is no transition with the id {number}'
    bench.until(lambda: bench.logged(expected), 'what was wrong in the log')
    assert go(bench, node, 'deactivate') == 'inactive'


def test_a_label_is_told_from_an_id(bench, parrot) -> None:
    node = parrot(autostart_node=True)
    assert not change(bench, node, IDS['deactivate'], 'dance')
    assert not change(bench, node, IDS['deactivate'], 'activate')
    assert node.state == 'active'
    assert change(bench, node, 99, 'deactivate')  # a known label beats a wrong id
    assert node.state == 'inactive'


@pytest.mark.parametrize('part', ['configure', 'activate'])
def test_a_refusal_is_one_line_and_leaves_the_node_as_it_was(bench, parrot, part) -> None:
    node = parrot()
    before = entities(node)
    go(bench, node, *['configure'][: part == 'activate'])
    state, between = node.state, entities(node)
    node.fails = {part: OSError('the disk is full')}
    assert not change(bench, node, IDS[part])
    assert (node.state, entities(node)) == (state, between)
    bench.until(lambda: bench.logged(f'{part} failed: the disk is full'), 'the reason in the log')
    assert not bench.logged('Traceback')
    node.fails = {}
    assert go(bench, node, *IDS.keys() & {part}) != state
    go(bench, node, *['deactivate'][: part == 'activate'], 'cleanup')
    assert entities(node) == before


@pytest.mark.parametrize('part', ['configure', 'activate', 'deactivate', 'cleanup'])
def test_a_mistake_is_logged_and_the_node_can_be_had_again(bench, parrot, part) -> None:
    node = parrot()
    before = entities(node)
    way = {
        'configure': [],
        'activate': ['configure'],
        'deactivate': ['configure', 'activate'],
        'cleanup': ['configure'],
    }[part]
    go(bench, node, *way)
    node.fails = {part: KeyError('a mistake')}
    assert not change(bench, node, IDS[part])
    assert (node.state, entities(node)) == ('unconfigured', before)
    bench.until(lambda: bench.logged(f'{part} failed: Traceback'), 'the mistake in the log')
    assert "KeyError: 'a mistake'" in bench.logged(f'{part} failed: ')[0]
    node.fails = {}
    assert go(bench, node, 'configure', 'activate') == 'active'


@pytest.mark.parametrize('part', ['deactivate', 'cleanup'])
def test_a_node_that_does_not_come_to_rest_is_brought_to_it(bench, parrot, part) -> None:
    node = parrot()
    before = entities(node)
    go(bench, node, *['configure', 'activate'][: 2 if part == 'deactivate' else 1])
    node.fails = {part: OSError('not now')}
    assert not change(bench, node, IDS[part])
    assert (node.state, entities(node)) == ('unconfigured', before)


@pytest.mark.parametrize('part', ['deactivate', 'cleanup'])
def test_nothing_keeps_a_node_from_its_end(bench, parrot, part) -> None:
    node = parrot(autostart_node=True)
    node.fails = {part: OSError('not now')}
    assert change(bench, node, label='shutdown')
    assert node.state == 'finalized'
    assert node.calls[2:] == ['deactivate', 'cleanup']
    assert bench.call('parrot/talk').message == '/parrot is finalized; start it anew'


@pytest.mark.parametrize('error', [OSError('the disk is full'), KeyError('a mistake')])
def test_what_keeps_a_node_from_starting_is_raised(bench, parrot, monkeypatch, error) -> None:
    def fail(self: ManagedNode) -> None:
        raise error

    kind = type(parrot())
    monkeypatch.setattr(kind, 'activate', fail)
    with pytest.raises(type(error)) as raised:
        bench.start(kind)
    assert raised.value is error
    bench.settle()
    assert not bench.logged('failed')  # once is enough: run.py says it
    assert bench.probe.get_node_names().count('parrot') == 1  # the first one


def test_what_fails_after_a_start_by_itself_is_logged(bench, parrot) -> None:
    node = parrot(autostart_node=True)
    go(bench, node, 'deactivate')
    node.fails = {'activate': OSError('the disk is full')}
    assert not change(bench, node, IDS['activate'])
    bench.until(lambda: bench.logged('activate failed: the disk is full'), 'the reason in the log')


def test_a_node_that_nobody_can_ask_starts(bench, parrot) -> None:
    kind = type(parrot())
    assert bench.start(partial(kind, enable_communication_interface=False)).state == 'active'


def test_the_answers_of_rclpy_are_never_left_to_a_kind_of_node(parrot) -> None:
    with pytest.raises(TypeError, match=r'Loose\.on_activate: write activate\(\) instead'):

        class Loose(ManagedNode):
            def on_activate(self, state):
                """Return None: rclpy would be stuck in activating."""


def test_whatever_a_part_returns_the_node_is_not_stuck(bench, parrot, monkeypatch) -> None:
    node = parrot()
    answers = {'configure': False, 'activate': 'no', 'deactivate': 3, 'cleanup': node}
    for part, answer in answers.items():
        monkeypatch.setattr(type(node), part, lambda _, answer=answer: answer)
    assert go(bench, node, 'configure', 'activate', 'deactivate', 'cleanup') == 'unconfigured'


def test_configured_and_cleaned_up_again_and_again_it_leaves_nothing(bench, parrot) -> None:
    assert_cycles_leave_nothing(bench, parrot())
    bench.until(lambda: not bench.probe.count_publishers('/words'), 'its topics to be gone')


def test_a_node_that_is_destroyed_is_gone_at_once(bench, parrot) -> None:
    node = parrot(autostart_node=True)
    assert_gone_at_once(bench, node)
    node.destroy_node()  # a second time is nothing
    assert node.state == 'finalized'
