"""An order to start lapses: nothing drives minutes later, when what was missing comes."""

import pytest
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo
from servo_rig import Rig, some, STAMP_NS

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes import qos

GOAL, OTHER = 11, 12  # numbers of photographs


class Armed(Rig):
    """A servo that waits for ``~/start``, and for tracks of photographs by their numbers."""

    goal = GOAL

    def __init__(self, bench, **values) -> None:
        super().__init__(bench, **{'autostart': False, **values})

    def order(self):
        return self.bench.call('servo_node/start')

    def says(self, word: str) -> None:
        """Wait for a phase as others hear it."""
        self.run.report()
        self.bench.until(lambda: self.words and self.words[-1].data == word, f'phase {word}')

    @property
    def message(self) -> str:
        return str(self.reports[-1].status[0].message)

    def let_time_pass(self, seconds: float) -> None:
        """Let the steady clock go on, and the watchdog look."""
        self.clock.go_on(seconds)
        self.watch()


@pytest.fixture
def armed(bench, clock):
    """Return how to make a servo whose steady clock is set by hand."""

    def make(**values) -> Armed:
        rig = Armed(bench, **values)
        rig.clock = clock
        return rig

    return make


@pytest.mark.parametrize(
    ('calibrated', 'photograph', 'lacking'),
    [
        (False, GOAL, ['no usable camera_info yet']),
        (True, 0, ['the tracker has no photograph']),
        (True, None, ['no tracks have come yet']),
        (False, None, ['no usable camera_info yet', 'no tracks have come yet']),
        (CameraInfo(), GOAL, ['camera_info cannot be used']),
    ],
)
def test_what_is_missing_is_answered_and_what_comes_later_starts_nothing(
    bench, calibrated, photograph, lacking
) -> None:
    rig = Armed(bench, calibrated=calibrated is True)
    if isinstance(calibrated, CameraInfo):
        rig.hear(calibrated)
    if photograph is not None:
        rig.goal = photograph
        rig.show()
    answer = rig.order()
    assert not answer.success
    assert all(text in answer.message for text in lacking)
    rig.goal = GOAL
    rig.hear()
    rig.stand()
    rig.says('waiting')


def test_tracks_that_have_stopped_coming_are_missing(armed) -> None:
    rig = armed(stale_timeout=0.5)
    rig.see()
    rig.clock.go_on(3.0)
    answer = rig.order()
    assert (answer.success, 'no tracks have come for 3 s' in answer.message) == (False, True)


def test_where_nothing_is_missing_it_drives_by_the_next_image(bench) -> None:
    rig = Armed(bench, autostart=ServoSettings().autostart)
    rig.see()
    assert rig.commands == []
    bench.until(lambda: bench.logged('stands until /servo_node/start is called'), 'what to do')
    answer = rig.order()
    assert (answer.success, answer.message) == (True, 'started')
    rig.says('armed')
    rig.see()
    assert rig.twists()[-1] != STANDSTILL
    rig.says('displacing')


def test_a_photograph_out_of_view_arms_it_for_a_while(bench, armed) -> None:
    rig = armed()
    rig.show()
    answer = rig.order()
    text = 'armed, will drive once this is resolved: no feature of the photograph is in view'
    assert (answer.success, answer.message) == (True, f'{text}; the order lapses after 10 s')
    rig.show()
    rig.says('armed')
    bench.until(lambda: rig.message == text, 'the diagnostics')
    rig.let_time_pass(9.0)
    rig.see()
    assert rig.twists()[-1] != STANDSTILL


@pytest.mark.parametrize('timeout', [10.0, 2.0])
def test_an_order_lapses_by_which_no_run_has_begun_in_time(bench, armed, timeout) -> None:
    rig = armed(arming_timeout=timeout)
    rig.show()
    assert rig.order().success
    rig.let_time_pass(timeout + 0.1)
    rig.says('waiting')
    rig.stand()
    text = 'waiting: ~/start has expired, the robot did not begin to drive in time'
    bench.until(lambda: rig.message.startswith(text), 'the diagnostics')
    assert rig.message.endswith('stands until /servo_node/start is called')
    bench.until(lambda: bool(bench.logged('~/start has expired')), 'the log')
    assert rig.order().success
    rig.see()
    assert rig.twists()[-1] != STANDSTILL


def test_a_run_that_has_begun_does_not_lapse(armed) -> None:
    rig = armed()
    rig.see()
    assert rig.order().success
    rig.see()
    rig.let_time_pass(60.0)
    rig.see()
    assert rig.twists()[-1] != STANDSTILL


@pytest.mark.parametrize(
    ('seen', 'photograph', 'why'),
    [
        (True, OTHER, 'the photograph has changed'),
        (False, OTHER, 'the photograph has changed'),
        (False, 0, 'the photograph is gone'),
    ],
    ids=['was in view', 'out of view', 'gone'],
)
def test_another_photograph_or_none_ends_an_order(bench, seen, photograph, why) -> None:
    rig = Armed(bench)
    if seen:
        rig.see()
    rig.show()
    assert rig.order().success
    if not seen:
        rig.show(some(3))
    rig.goal = photograph
    if not photograph:
        rig.show()
    rig.stand()
    assert rig.commands == []
    rig.says('waiting')
    assert f'~/start has expired, {why}' in rig.message


def test_a_clock_that_comes_minutes_later_sets_nothing_moving(bench, armed) -> None:
    rig = armed(max_latency=0.5, use_sim_time=True)
    rig.see()
    answer = rig.order()
    assert (answer.success, 'is /clock published?' in answer.message) == (True, True)
    rig.let_time_pass(10.1)
    bench.talk(Clock, '/clock', qos.CLOCK)(write.clock(STAMP_NS))
    bench.until(lambda: rig.node.get_clock().now().nanoseconds == STAMP_NS, 'the clock')
    rig.stamp_ns = STAMP_NS
    rig.stand()


def test_by_autostart_it_is_armed_for_good_and_for_any_photograph(armed) -> None:
    rig = armed(autostart=True)
    rig.says('armed')
    rig.goal = 0
    rig.show()
    rig.let_time_pass(3600.0)
    rig.show()
    rig.let_time_pass(3600.0)
    assert rig.order().success
    rig.let_time_pass(3600.0)
    rig.goal = OTHER
    rig.see()
    assert rig.twists()[-1] != STANDSTILL


def test_after_a_stop_an_order_lapses_with_autostart_as_well(bench, armed) -> None:
    rig = armed(autostart=True)
    rig.show()
    assert bench.call('servo_node/stop').success
    rig.says('waiting')
    assert rig.order().success
    rig.let_time_pass(10.1)
    rig.stand()


def test_a_start_in_a_run_leaves_it_alone(bench) -> None:
    rig = Armed(bench)
    rig.see()
    rig.order()
    rig.see()
    answer = rig.order()
    assert (answer.success, answer.message) == (True, 'a run is under way')
    rig.see()
    assert rig.twist != STANDSTILL
