"""The executor of a process: messages, timers and services are served, whatever else goes on."""

from collections.abc import Iterator
from functools import partial
import sys
import time
from typing import Any

from bench import Bench, RELIABLE
import pytest
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import UInt32
from std_srvs.srv import Trigger

from visual_servo_epipolar.nodes.startup.run import new_executor

TOPIC = 'numbers'


class Plain(Bench):
    """Bench whose probe is spun by one executor of those under test."""

    def __init__(self, with_info: bool) -> None:
        super().__init__()
        self.executor.remove_node(self.probe)
        self.executor.shutdown()
        self.executor = new_executor(self.context, with_info=with_info)
        self.executor.add_node(self.probe)


@pytest.fixture(params=[False, True], ids=['events', 'with_info'])
def spun(request) -> Iterator[Bench]:
    """Return a bench whose probe is spun by the executor under test."""
    with Plain(request.param) as bench:
        yield bench


def test_before_rclpy_7_1_4_there_is_the_older_executor(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, 'rclpy.experimental', None)
    with Plain(with_info=False) as bench:
        assert isinstance(bench.executor, SingleThreadedExecutor)
        bench.settle()


def talk(bench: Bench) -> Any:
    say = bench.talk(UInt32, TOPIC)
    publisher = list(bench.probe.publishers)[-1]
    bench.until(lambda: publisher.get_subscription_count() > 0, 'the ear to be known')
    return lambda number: say(UInt32(data=number))


def test_a_flood_of_messages_keeps_no_timer_and_no_service_from_its_turn(spun) -> None:
    say: list[Any] = []
    heard: list[int] = []

    def again(message: UInt32) -> None:  # there is always a message
        heard.append(message.data)
        say[0](message.data + 1)

    spun.probe.create_subscription(UInt32, TOPIC, again, RELIABLE)
    say.append(talk(spun))
    ticks: list[float] = []
    spun.probe.create_timer(0.01, lambda: ticks.append(time.monotonic()))
    spun.probe.create_service(Trigger, 'ask', lambda _, answer: answer)
    say[0](0)
    spun.call('ask')
    spun.until(lambda: len(ticks) > 10, 'the timer to tick')
    assert len(heard) > 10


def stand_still() -> None:
    """Do nothing for a while, as a machine that is busy otherwise."""
    until = time.monotonic() + 0.05
    while time.monotonic() < until:
        pass


def test_a_timer_that_is_always_due_keeps_no_message_from_its_turn(spun) -> None:
    heard = spun.listen(UInt32, TOPIC)
    say = talk(spun)
    spun.probe.create_timer(0.001, stand_still)
    say(0)
    spun.until(lambda: bool(heard), 'the message')


def test_subscriptions_may_be_destroyed_while_messages_are_on_the_way(spun) -> None:
    heard: list[int] = []
    ears: list[Any] = []

    def hear(other: int, _: UInt32) -> None:
        heard.append(other)
        spun.probe.destroy_subscription(ears[other])

    for other in (1, 0):
        ears.append(spun.probe.create_subscription(UInt32, TOPIC, partial(hear, other), RELIABLE))
    publisher = spun.probe.create_publisher(UInt32, TOPIC, RELIABLE)
    spun.until(lambda: publisher.get_subscription_count() == 2, 'both ears to be known')
    publisher.publish(UInt32())
    stand_still()  # until both have it
    spun.until(lambda: bool(heard), 'the message')
    spun.settle()
    publisher.publish(UInt32())
    spun.settle()
    assert len(heard) == 2


@pytest.mark.parametrize('raw', [False, True])
def test_a_callback_may_want_bytes_and_to_know_where_they_come_from(raw) -> None:
    heard: list[Any] = []
    with Plain(with_info=True) as spun:
        spun.probe.create_subscription(
            UInt32, TOPIC, lambda message, info: heard.append((message, info)), RELIABLE, raw=raw
        )
        talk(spun)(7)
        spun.until(lambda: len(heard) == 1, 'the message')
    message, info = heard[0]
    assert isinstance(message, bytes if raw else UInt32)
    assert info['source_timestamp'] > 0


@pytest.mark.parametrize('timer', [False, True])
def test_what_a_callback_raises_ends_the_spin(spun, timer) -> None:
    def complain(*_: object) -> None:
        raise RuntimeError('a mistake')

    if timer:
        spun.probe.create_timer(0.001, complain)
    else:
        spun.probe.create_subscription(UInt32, TOPIC, complain, RELIABLE)
        talk(spun)(5)
    with pytest.raises(RuntimeError, match='a mistake'):
        spun.until(lambda: False, 'the error')
