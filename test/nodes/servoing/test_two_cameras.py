"""Where two cameras speak in turns nobody drives, though every other word is of the right one."""

from dataclasses import replace

from servo_rig import CAMERA, PERIOD_NS, Rig

from visual_servo_epipolar.core.geometry.motion import STANDSTILL
from visual_servo_epipolar.messages import write

OTHER = replace(CAMERA, fx=1000.0, fy=1000.0)
DISTRUST_S = 2.0  # as the servo has it
IMAGES = round(DISTRUST_S * 1e9 / PERIOD_NS) - 1


def flicker(rig: Rig) -> None:
    """Let another camera speak, and then the right one again."""
    for camera in (OTHER, CAMERA):
        rig.calibrate(write.camera_info(camera, rig.stamp_ns, 'camera'))
        rig.bench.until(lambda camera=camera: rig.node._camera.model == camera, 'camera_info')


def test_a_run_waits_after_a_word_of_another_camera(bench) -> None:
    rig = Rig(bench).drive()
    flicker(rig)
    count = len(rig.commands)
    for _ in range(IMAGES):
        rig.see()
    assert rig.phase == 'holding'
    assert 'camera_info has changed in mid-run' in rig.node._state.reason
    assert all(twist == STANDSTILL for twist in rig.twists()[count:])
    rig.drive()


def test_a_new_run_does_not_wait(bench) -> None:
    rig = Rig(bench, stale_timeout=5.0).drive()  # also where the machine stands still
    flicker(rig)
    rig.node._run.reset()
    rig.drive()
