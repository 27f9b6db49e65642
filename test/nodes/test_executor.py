"""The executor of a process: ends of topics that go, and mistakes that end it."""

from collections.abc import Iterator
from functools import partial
import sys
from typing import Any

from bench import Bench, RELIABLE
import pytest
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import UInt32

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
    spun.until(lambda: bool(heard), 'the message')
    spun.settle()
    publisher.publish(UInt32())
    spun.settle()
    assert len(heard) == 2


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
