"""Worlds with real nodes on a wire: repeatable, and the judge finds what was broken in them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from rclpy.publisher import Publisher
from std_msgs.msg import String

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import Twist
from visual_servo_epipolar.evaluation.faults import campaign
from visual_servo_epipolar.evaluation.faults.fault import Fault, StruckRun
from visual_servo_epipolar.evaluation.faults.table import becomes, FAULTS
from visual_servo_epipolar.evaluation.faults.world import (
    open_world,
    small_camera,
    WorldSettings,
)
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.simulation.bases import PioneerSettings

SEED = 3  # starts in front, without a retreat
DRAWN_WORLD = campaign._world


@pytest.fixture(autouse=True)
def near_start(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let runs begin so near that they are short."""

    def world(seed: int, rng: np.random.Generator, *, beside: bool) -> WorldSettings:
        return WorldSettings(start=(0.1, -0.7, 2.0), seed=seed, camera=small_camera(seed))

    monkeypatch.setattr(campaign, '_world', world)


def images_end(scene: StruckRun) -> None:
    scene.filter('/image_raw', lambda envelope: [], None)


@pytest.fixture(autouse=True)
def strikes_far_from_the_goal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, 'WHOLE_WAY_S', 2.0)


def driven(name: str, fault: Fault) -> dict[str, object]:
    return campaign.drive_one(name, replace(fault, stages=Fault.stages), SEED)


def test_a_fault_that_there_is_not_is_refused_before_any_run() -> None:
    with pytest.raises(InputError, match='unknown fault nune; did you mean none'):
        campaign.plan(['nune'], 1, 0)


def test_a_run_in_which_nothing_is_wrong_arrives() -> None:
    result = campaign.drive_one('none', FAULTS['none'], SEED)
    assert result['verdict'] == 'arrived', result['charges']


def test_a_run_is_repeatable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(campaign, 'LONGEST_S', 2.5)
    first, second = (driven('none', FAULTS['none']) for _ in range(2))
    assert first == second


def test_a_camera_that_dies_leaves_a_robot_at_rest_with_a_reason() -> None:
    result = driven('end', Fault(what='', strike=images_end))
    assert (result['verdict'], result['safe']) == ('at rest', True)
    assert result['struck_in'] not in ('waiting', 'arrived')


def test_a_servo_whose_stop_was_removed_moves_without_sight(monkeypatch) -> None:
    monkeypatch.setattr(ServoNode, '_on_watch', lambda self: None)
    monkeypatch.setattr(campaign, 'LONGEST_S', 5.0)
    near = campaign._world

    def world(*given, **more):
        return replace(near(*given, **more), base=PioneerSettings(command_timeout=0.0))

    monkeypatch.setattr(campaign, '_world', world)
    result = driven('end', Fault(what='', strike=images_end))
    assert (result['verdict'], result['safe']) == ('moved without sight', False)
    assert result['blind_s'] > 1.0
    assert any('still moving' in charge for charge in result['charges'])


def test_a_servo_that_ignores_its_limits_is_condemned(monkeypatch: pytest.MonkeyPatch) -> None:
    def twice(value: Twist) -> object:
        return real(Twist(2.0 * value.linear, 2.0 * value.angular))

    real: Callable[[Twist], object] = write.twist

    def strike(scene: StruckRun) -> None:
        monkeypatch.setattr(write, 'twist', twice)
        scene.later(2.0, lambda: scene.world.call('/servo_node/stop'))

    result = driven('wild', Fault(what='', strike=strike))
    assert any('limits exceeded' in charge for charge in result['charges'])


def test_a_node_that_raises_is_a_traceback_and_its_world_goes_on(monkeypatch) -> None:
    def strike(scene: StruckRun) -> None:
        monkeypatch.setattr(ServoNode, '_drive_by', lambda *_: {}['nothing'])

    result = driven('raises', Fault(what='', strike=strike))
    assert result['verdict'] == 'traceback'
    assert "KeyError: 'nothing'" in str(result['detail'])


def test_messages_reach_nodes_through_cdr_and_hooks_do_not_stay() -> None:
    before, heard = Publisher.publish, []
    settings = WorldSettings(start=(0.0, -1.0, 0.0), seed=0, camera=small_camera(0))
    with open_world(settings) as world:
        world.wire.publish_listeners['/phase'].append(heard.append)
        world.start('servo_node')
        assert Publisher.publish is not before
        assert [envelope.message for envelope in heard] == [String(data='armed')]
    assert Publisher.publish is before


@pytest.mark.long
def test_a_base_that_stands_is_watched_until_the_run_fails_for_it(monkeypatch) -> None:
    monkeypatch.setattr(campaign, '_world', DRAWN_WORLD)

    strike = becomes('unicycle_node', dead_zone_linear=(1.0, 1.0), dead_zone_angular=(2.0, 2.0))
    result = driven('stuck', Fault(what='', strike=strike))
    assert (result['verdict'], result['phase']) == ('at rest', 'failed'), result['charges']
    assert '3 times in this run: the base does not follow' in str(result['detail'])


def test_runs_are_watched_for_longer_than_any_timeout_of_theirs() -> None:
    settings = WorldSettings(start=(0.0, -1.0, 0.0), seed=0, camera=small_camera(0)).servo
    longest_s = max(settings.run_timeout, settings.phase_timeout) + settings.holding_timeout
    assert campaign.LONGEST_S > longest_s + campaign.REST_S


def test_what_fails_in_the_campaign_itself_is_not_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*run: object) -> object:
        raise KeyError('wire')

    monkeypatch.setattr(campaign, 'drive_one', fail)
    result = campaign.one(campaign.FaultRun('none', 0))
    assert (result['verdict'], result['safe']) == ('not judged', False)
    assert result['detail'] == "KeyError: 'wire'"


def test_a_button_that_was_pressed_leaves_the_robot_at_rest() -> None:
    result = driven('order_button', FAULTS['order_button'])
    assert (result['verdict'], result['phase']) == ('at rest', 'waiting'), result['charges']


def test_a_base_whose_process_is_gone_stands() -> None:
    result = driven('unicycle_killed', FAULTS['unicycle_killed'])
    assert result['verdict'] == 'at rest', result['charges']
    assert result['duration_s'] < campaign.LONGEST_S
