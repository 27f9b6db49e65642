"""The life cycle of the servo: no twist unless active, the last one zero, no run by itself."""

import random

from lifecycles import change, entities, go
import pytest
from rclpy.parameter import Parameter
from servo_rig import PERIOD_NS, Rig, tracks
from std_msgs.msg import Bool, String

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.messages import event_log, write
from visual_servo_epipolar.nodes import qos

STEPS = 80
LABELS = ('configure', 'cleanup', 'activate', 'deactivate')


class Led(Rig):
    """A servo that is led about, its camera, and its tracks one by one."""

    def __init__(self, bench, **values) -> None:
        self.events = bench.listen(String, 'servo_node/events')
        super().__init__(bench, calibrated=False, **values)

    def see(self) -> None:
        """Let the tracks of another image, with its camera_info, arrive."""
        self.hear()
        self.see_tracks()

    def see_tracks(self) -> None:
        self.send(tracks(stamp_ns=self.stamp_ns))
        self.stamp_ns += PERIOD_NS
        self.bench.settle()

    @property
    def moving(self) -> bool:
        return self.twist != STANDSTILL


@pytest.fixture
def rig(bench):
    return Led(bench)


@pytest.mark.parametrize('way', [('deactivate',), ('shutdown',), ('deactivate', 'cleanup')])
def test_led_away_in_mid_run_it_stops_the_robot_and_is_silent(rig, way) -> None:
    rig.drive()
    for label in way:
        assert change(rig.bench, rig.node, label=label)
    rig.bench.until(lambda: not rig.moving, 'the zero twist')
    told, phases = len(rig.commands), len(rig.words)
    rig.see()
    assert (len(rig.commands), len(rig.words)) == (told, phases)
    assert rig.words[-1].data == 'waiting'
    assert event_log.from_text(rig.events[-1].data).event == 'reset'  # for replays


def test_deactivated_while_it_holds_it_tells_the_base_once_more_to_stand(rig) -> None:
    rig.drive().send(write.features(Features(), rig.stamp_ns, 'camera'))
    rig.bench.until(lambda: not rig.moving, 'the zero twist')
    told = len(rig.commands)
    go(rig.bench, rig.node, 'deactivate')
    rig.bench.until(lambda: len(rig.commands) > told, 'another zero twist')
    assert not rig.moving


def test_a_run_never_goes_on_by_itself(bench) -> None:
    rig = Led(bench, autostart=False)
    rig.see()
    assert bench.call('servo_node/start').success
    rig.drive()
    go(bench, rig.node, 'deactivate', 'activate')
    told = len(rig.commands)
    rig.see()
    assert (rig.moving, len(rig.commands), rig.words[-1].data) == (False, told, 'waiting')
    assert bench.call('servo_node/start').success
    rig.drive()


@pytest.mark.parametrize(
    'way',
    [
        ('stop', 'deactivate', 'activate'),
        ('deactivate', 'stop', 'activate'),
        ('deactivate', 'cleanup', 'stop', 'configure', 'activate'),
    ],
)
def test_a_stop_is_heard_in_every_state_and_lasts_until_a_start(rig, way) -> None:
    rig.drive()
    for step in way:
        if step == 'stop':
            assert rig.bench.call('servo_node/stop').success
            assert rig.node.is_active or not rig.bench.call('servo_node/start').success
        else:
            go(rig.bench, rig.node, step)
    rig.stand()
    assert rig.bench.call('servo_node/start').success
    go(rig.bench, rig.node, 'deactivate', 'activate')
    rig.drive()


def test_a_stop_button_is_heard_in_every_state_and_lasts(rig) -> None:
    press = rig.bench.talk(Bool, 'stop_button')
    rig.drive()
    go(rig.bench, rig.node, 'deactivate', 'cleanup')
    press(Bool(data=True))
    rig.bench.settle()
    go(rig.bench, rig.node, 'configure', 'activate')
    rig.stand()
    assert not rig.bench.call('servo_node/start').success
    press(Bool(data=False))
    rig.bench.settle()
    assert rig.bench.call('servo_node/start').success
    rig.drive()


def test_the_camera_is_kept_while_inactive_and_asked_for_anew_after_a_cleanup(rig) -> None:
    rig.drive()
    go(rig.bench, rig.node, 'deactivate', 'activate')
    for _ in range(5):
        rig.see_tracks()
    assert rig.moving
    go(rig.bench, rig.node, 'deactivate', 'cleanup', 'configure', 'activate')
    rig.bench.until(lambda: not rig.moving, 'the zero twist')
    rig.see_tracks()
    assert not rig.moving
    rig.bench.until(lambda: rig.bench.logged('no usable camera_info yet'), 'what it waits for')
    rig.drive()


def test_a_parameter_that_changes_in_any_state_holds_when_it_is_active(bench) -> None:
    rig = Led(bench, autostart_node=False)
    settings = bench.listen(String, 'servo_node/settings', qos.LATCHED)
    for value, way in ((0.11, 'configure'), (0.12, 'activate')):
        (answer,) = rig.node.set_parameters([Parameter('max_linear', value=value)])
        assert answer.successful
        go(bench, rig.node, way)
    bench.until(lambda: settings and '0.12' in settings[-1].data, 'the settings in force')
    assert '0.11' not in settings[-1].data


def test_led_about_at_random_in_mid_run_it_moves_while_active_alone(rig) -> None:
    chance, before, runs = random.Random(5), None, 0
    for _ in range(STEPS):
        rig.see()
        active, told = rig.node.is_active, len(rig.commands)
        runs += rig.moving
        assert active or not rig.moving
        change(rig.bench, rig.node, label=chance.choice(LABELS))
        if active and not rig.node.is_active:
            rig.bench.until(lambda: not rig.moving, 'the zero twist')  # noqa: B023
        elif not active:
            assert len(rig.commands) == told
        if rig.node.state == 'unconfigured':
            before = before or entities(rig.node)
            assert entities(rig.node) == before
    assert runs >= 3
