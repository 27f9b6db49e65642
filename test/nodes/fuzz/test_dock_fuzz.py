"""Whatever is said in mid-docking: goals come to an end, nothing is driven but for a goal."""

from bench import Bench
import fuzzing
from geometry_msgs.msg import Twist as TwistMessage
from lifecycles import go
import numpy as np
import pytest

pytest.importorskip('test_msgs', reason='pip install ros-jazzy-test-msgs==2.0.3')

from dock_requests import Client, SERVED, served, Servo, started  # noqa: E402

from visual_servo_epipolar.core.geometry.motion import STANDSTILL  # noqa: E402
from visual_servo_epipolar.core.laws.phase import Phase  # noqa: E402
from visual_servo_epipolar.messages import read  # noqa: E402

A_GOAL = 30  # messages to each subscription


def test_docking_outlives_all_that_it_hears(bench: Bench) -> None:
    servo, twists = Servo(bench), bench.listen(TwistMessage, 'cmd_vel')
    node = bench.start(served, **SERVED, camera_yaw=3.14)
    client, results = Client(bench), []

    def tell(rng, number: int) -> None:
        if number % A_GOAL == 0:  # it supersedes what is under way
            results.append(client.ask()[1])
        fuzzing.sent_to(node, rng)
        bench.executor.spin_once(timeout_sec=0.0)

    def is_quiet() -> bool:
        count = len(twists)
        bench.settle()
        return len(twists) == count

    fuzzing.assert_stays_small(tell, 8)
    bench.until(is_quiet, 'what was commanded to arrive')
    go(bench, node, 'deactivate')
    bench.until(lambda: read.twist(twists[-1]) == STANDSTILL, 'the zero twist')
    bench.until(lambda: all(result.done() for result in results), 'an end of every goal')
    bench.settle()
    told, rng = (len(servo.calls), len(twists)), np.random.default_rng(9)
    for _ in range(fuzzing.COUNT):
        fuzzing.sent_to(node, rng)
    bench.until(is_quiet, 'what was commanded to arrive')
    assert (len(servo.calls), len(twists)) == told
    go(bench, node, 'activate')
    begun = servo.calls.count('start')
    _, result = client.ask()
    started(bench, servo, begun + 1)
    servo.say(Phase.DISPLACING)
    servo.say(Phase.ARRIVED)
    assert client.outcome(result)[1][0] == 1
    client.close()
