"""What is heard over the wire, and what processes cost."""

import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import TwistStamped

from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.evaluation.benchmarks.latency import Answers, Cost, spent
from visual_servo_epipolar.messages import write


def answer(stamp_ns: int, linear: float) -> TwistStamped:
    return write.twist_stamped(Twist(linear, 0.0), stamp_ns, 'base_link')


def test_an_answer_is_known_by_the_number_of_its_image() -> None:
    drive = Answers(sent={100: 0.0, 200: 0.0, 300: 0.0})
    for stamp_ns, linear in ((100, 0.0), (300, 0.2), (400, 0.3)):
        drive.took(answer(stamp_ns, linear))
    assert drive.numbers == [0, 2]
    assert drive.twists == [Twist(0.0, 0.0), Twist(0.2, 0.0)]
    assert drive.moving == 1


def test_a_process_costs_what_it_took_in_the_stretches_that_count() -> None:
    def at(processor_s: float, memory_mb: float) -> dict[str, Cost]:
        return {'servo_node': Cost(processor_s, memory_mb, 130.0)}

    stretches = [(at(1.0, 100.0), at(1.2, 110.0)), (at(5.0, 115.0), at(5.3, 120.0))]
    assert spent(stretches, 100) == {
        'servo_node': {
            'processor_ms': pytest.approx(5.0),
            'memory_mb': [100.0, 120.0],
            'peak_mb': 130.0,
        }
    }
