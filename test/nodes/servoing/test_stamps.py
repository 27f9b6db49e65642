"""Images that are too old, or of another clock, are not driven by; it is said what to do."""

from bench import Bench
from lifecycles import go
import pytest
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock
from servo_rig import AWAY, Rig, STAMP_NS, tracks

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.laws.standing import RESUMING_FRAMES
from visual_servo_epipolar.core.servo.admission import Arrival, disorder, refusal
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.driving_inputs import NO_CAMERA

SECOND = 1_000_000_000
NOW_NS = 1_790_000_000 * SECOND
LATE = 'old when their tracks come, max_latency is 0.5 s'
OTHER = 'the clock of the servo; set the clock of their driver, or use_sim_time'
UNTIMELY = [(2.0, LATE), (-1.0, OTHER), (130.0, OTHER), (-900.0, OTHER)]


def aged(age: float, still_s: float = 0.0) -> Arrival:
    return Arrival(NOW_NS - int(age * SECOND), NOW_NS, still_s)


ARRIVALS = [
    *((aged(age), text) for age, text in UNTIMELY),
    (aged(0.51), LATE),
    (aged(-0.51), OTHER),
    (aged(130.0), '130.00 s behind the clock'),
    (aged(-1.0), '1.00 s ahead of the clock'),
    *((aged(age), '') for age in (0.5, 0.1, 0.0, -0.1, -0.5)),
    (Arrival(0, NOW_NS), 'the images are stamped 0'),
    (Arrival(0, 0), ''),  # a simulation that begins
    (Arrival(STAMP_NS, 0), 'is /clock published?'),
    (aged(-1.0, still_s=3.0), '/clock has stood still'),
    (aged(-1.0, still_s=0.1), OTHER),
]


@pytest.mark.parametrize(('arrival', 'text'), ARRIVALS)
def test_an_image_too_far_from_now_is_refused(arrival: Arrival, text: str) -> None:
    reason = refusal(arrival, 0.5)
    assert text in reason
    assert bool(reason) == bool(text)


STILL = 'the stamps do not advance'
ORDERS = [(1.1, 'went back by 1.1 s'), (0.9, STILL), (0.0, STILL), (-0.1, ''), (-5.0, '')]


@pytest.mark.parametrize(('back_s', 'text'), ORDERS)
def test_a_leap_backwards_is_more_than_an_image_that_was_overtaken(back_s, text) -> None:
    reason = disorder(NOW_NS, NOW_NS - round(back_s * SECOND), '~/stop, then ~/start')
    assert text in reason
    assert bool(reason) == bool(text)


class Present(Rig):
    """A servo whose images are of now, or ``age`` seconds older."""

    def __init__(self, bench: Bench, **values) -> None:
        super().__init__(bench, **{'max_latency': 0.5, **values})

    def see(self, pose=AWAY, age: float = 0.0) -> None:
        now_ns = self.node.get_clock().now().nanoseconds
        self.tell(tracks(pose, now_ns - round(age * SECOND)))


@pytest.mark.parametrize(('age', 'text'), UNTIMELY)
def test_no_run_begins_by_an_untimely_image(bench, age, text) -> None:
    rig = Present(bench)
    rig.see(age=age)
    assert (rig.commands, rig.phase) == ([], 'waiting')
    bench.until(lambda: bench.logged(text), 'the reason')
    rig.run.report()
    assert text in rig.reason


@pytest.mark.parametrize(('age', 'text'), UNTIMELY)
def test_a_robot_that_drives_is_stopped_by_an_untimely_image(bench, age, text) -> None:
    rig = Present(bench).drive()
    rig.see(age=age)
    assert (rig.phase, rig.twists()[-1]) == ('holding', STANDSTILL)
    assert text in rig.reason
    count = len(rig.commands)
    rig.see(age=age)
    assert (rig.phase, len(rig.commands)) == ('holding', count)
    rig.stand(RESUMING_FRAMES - 1)
    rig.see(age=age)  # which begins the row of trusted ones anew
    rig.resume()


def test_the_largest_latency_may_be_changed_on_the_way(bench) -> None:
    rig = Present(bench)
    rig.node.set_parameters([Parameter('max_latency', value=0.0)])
    rig.see(age=2.0)
    assert rig.twists()[-1] != STANDSTILL


def test_where_time_itself_waits_no_image_is_late(bench) -> None:
    rig = Present(bench, watchdog=False)
    rig.see(age=1e9)
    assert rig.twists()[-1] != STANDSTILL


def test_in_simulated_time_the_age_is_by_its_clock(bench) -> None:
    rig = Rig(bench, max_latency=0.5, use_sim_time=True)
    tick = bench.talk(Clock, '/clock', qos.CLOCK)

    def show(now_ns: int) -> None:
        tick(write.clock(now_ns))
        bench.until(lambda: rig.node.get_clock().now().nanoseconds == now_ns, 'the clock')
        rig.see()

    show(STAMP_NS)
    assert rig.twists()[-1] != STANDSTILL
    show(STAMP_NS + 2 * SECOND)
    assert (rig.phase, rig.twists()[-1]) == ('holding', STANDSTILL)


def test_a_bag_played_in_a_loop_ends_the_run(bench) -> None:
    rig = Rig(bench, stale_timeout=0.2, holding_timeout=0.3)
    for _ in range(14):
        rig.see()
    rig.stamp_ns = STAMP_NS
    rig.see()
    assert (rig.phase, rig.twists()[-1]) == ('holding', STANDSTILL)
    bench.until(lambda: bool(bench.logged('the stamps went back by 1.2 s')), 'the reason')
    count = len(rig.commands)
    while rig.phase == 'holding':
        rig.see()
        if rig.stamp_ns > STAMP_NS + SECOND:
            rig.stamp_ns = STAMP_NS
    assert rig.phase == 'failed'
    assert all(twist == STANDSTILL for twist in rig.twists()[count:])
    assert bench.logged('a bag played in a loop')


@pytest.mark.parametrize('back_ns', [0, 90_000_000], ids=['repeated', 'overtaken'])
def test_an_image_that_comes_too_late_or_again_is_not_driven_by(bench, back_ns) -> None:
    rig = Rig(bench).drive()
    rig.tell(tracks(stamp_ns=rig.run.stamp_ns - back_ns))
    assert (rig.phase, rig.twists()[-1]) == ('holding', STANDSTILL)


@pytest.mark.parametrize('orders', [['stop', 'start'], ['reset']])
def test_a_new_run_may_begin_with_stamps_of_before(bench, orders) -> None:
    rig = Rig(bench).drive()
    for order in orders:
        assert bench.call(f'servo_node/{order}').success
    rig.stamp_ns = STAMP_NS - 5 * SECOND  # another bag
    rig.drive()


def test_where_clock_freezes_and_images_go_on_that_is_the_reason(bench, clock) -> None:
    rig = Rig(bench, max_latency=0.5, use_sim_time=True)
    tick = bench.talk(Clock, '/clock', qos.CLOCK)
    for _ in range(2):
        tick(write.clock(rig.stamp_ns))
        bench.until(lambda: rig.node.get_clock().now().nanoseconds == rig.stamp_ns, 'the clock')
        rig.see()
    assert rig.twists()[-1] != STANDSTILL
    rig.watch()
    clock.go_on(2.0)
    rig.stamp_ns += 2 * SECOND
    rig.see()
    assert (rig.phase, rig.twists()[-1]) == ('holding', STANDSTILL)
    assert '/clock has stood still at 7.09 s for 2.' in rig.reason
    assert 'the clock of their driver' not in rig.reason


def test_tracks_that_have_waited_for_too_long_are_not_driven_by(bench) -> None:
    rig = Rig(bench, calibrated=False, stale_timeout=0.1)
    rig.see()
    bench.pass_time(0.15)
    rig.hear()
    assert rig.commands == []


@pytest.mark.parametrize('order', ['stop', 'reset', 'rest'])
def test_tracks_from_before_an_order_are_not_driven_by(bench, order) -> None:
    rig = Rig(bench, calibrated=False)
    rig.see()
    if order == 'rest':
        go(bench, rig.node, 'deactivate', 'activate')
    else:
        assert bench.call(f'servo_node/{order}').success
    if order == 'stop':
        answer = bench.call('servo_node/start')
        assert (answer.success, NO_CAMERA in answer.message) == (False, True)
    rig.hear()
    assert all(twist == STANDSTILL for twist in rig.twists())
    if order == 'stop':
        assert bench.call('servo_node/start').success
    rig.drive()
