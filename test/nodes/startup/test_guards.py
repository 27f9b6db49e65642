"""Requests and times that would end any node of rclpy: they are refused, and it lives on."""

import pytest
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter as Change
from rosgraph_msgs.msg import Clock
from servo_rig import Rig

from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.startup.guards import BEFORE_TIME
from visual_servo_epipolar.nodes.unicycle_node import UnicycleNode


def of_type(number: int) -> Parameter:
    return Parameter(name='max_linear', value=ParameterValue(type=number, double_value=0.1))


@pytest.mark.parametrize('number', [10, 255])
def test_a_parameter_of_no_type_is_refused(bench, number) -> None:
    rig = Rig(bench, stale_timeout=5.0).drive()  # also where the machine stands still
    many = [of_type(3), of_type(number)]
    for kind, name in (
        (SetParameters, 'set_parameters'),
        (SetParametersAtomically, 'set_parameters_atomically'),
    ):
        answer = bench.call(f'servo_node/{name}', kind, kind.Request(parameters=many))
        results = answer.results if kind is SetParameters else [answer.result]
        assert not any(item.successful for item in results)
        text = f"'max_linear' must have a type from 0 to 9, got {number}"
        assert {item.reason for item in results} == {text}
    rig.drive()


@pytest.mark.parametrize('from_the_start', [True, False])
def test_a_clock_below_zero_is_left_out(bench, from_the_start) -> None:
    tick = bench.talk(Clock, '/clock', qos.CLOCK)
    node = bench.start(UnicycleNode, use_sim_time=from_the_start)
    node.set_parameters([Change('use_sim_time', value=True)])
    bench.settle()
    for seconds in (5, -1, 6, -(2**31)):
        tick(write.clock(seconds * 1_000_000_000))
        bench.settle()
    assert node.get_clock().now().nanoseconds == 6_000_000_000
    bench.until(lambda: bool(bench.logged(BEFORE_TIME)), 'what is wrong')
