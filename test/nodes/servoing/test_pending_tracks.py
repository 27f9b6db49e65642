"""Tracks that wait for camera_info: they are driven by while they are new, and no order came."""

from lifecycles import go
import pytest
from servo_rig import CAMERA, Rig

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.messages import write
from visual_servo_epipolar.nodes.servoing.camera import NO_CAMERA


def calibrated(rig: Rig) -> Rig:
    rig.calibrate(write.camera_info(CAMERA, 0, 'camera'))
    rig.bench.until(lambda: rig.node._camera.model is not None, 'camera_info to arrive')
    rig.bench.settle()
    return rig


def test_tracks_that_have_waited_for_too_long_are_not_driven_by(bench) -> None:
    rig = Rig(bench, calibrated=False, stale_timeout=0.1)
    rig.see()
    bench.until(lambda: rig.node._is_stale, 'the tracks to be old')
    assert calibrated(rig).commands == []


def stop(rig: Rig) -> None:
    assert rig.bench.call('servo_node/stop').success
    answer = rig.bench.call('servo_node/start')
    assert (answer.success, NO_CAMERA in answer.message) == (False, True)


def reset(rig: Rig) -> None:
    assert rig.bench.call('servo_node/reset').success


def rest(rig: Rig) -> None:
    go(rig.bench, rig.node, 'deactivate', 'activate')


@pytest.mark.parametrize('order', [stop, reset, rest])
def test_tracks_from_before_an_order_are_not_driven_by(bench, order) -> None:
    rig = Rig(bench, calibrated=False, stale_timeout=60.0)
    rig.see()
    order(rig)
    assert all(twist == STANDSTILL for twist in calibrated(rig).twists())
    if order is stop:
        assert rig.bench.call('servo_node/start').success
    rig.drive()
