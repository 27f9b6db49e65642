"""A second process draws a part of each image; no bit depends on whether it does."""

from contextlib import contextmanager
from functools import partial
import multiprocessing
import os
import signal
import threading

from durations import few_of
import numpy as np
import pytest

from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.simulation.mounts.camera_settings import CameraSettings
from visual_servo_epipolar.simulation.mounts.registry import new_rig
from visual_servo_epipolar.simulation.rendering import assistant as assistant_module
from visual_servo_epipolar.simulation.rendering.assistant import Assistant, Sharing, STRIP
from visual_servo_epipolar.simulation.rendering.raster import PinholeView, Raster, rasterize
from visual_servo_epipolar.simulation.rendering.renderer import Renderer
from visual_servo_epipolar.simulation.rendering.strips import Strip
from visual_servo_epipolar.simulation.rooms.scene import room

SMALL = {'width': 320, 'height': 256, 'focal_length': 190.0, 'principal_u': 158.0}
PINHOLE = CameraSettings(**SMALL, principal_v=128.0)
BARREL = CameraSettings(**SMALL, principal_v=128.0, distortion=(-0.2, 0.05, 0.0, 0.0, 0.0))
FISHEYE = CameraSettings(
    **SMALL | {'focal_length': 90.0},
    principal_v=128.0,
    distortion_model='equidistant',
    distortion=(0.01, 0.0, 0.0, 0.0),
)
POSES = [Pose.from_start(0.3, -2.5 + 0.2 * k, 4.0 * k) for k in range(4)]
PIXELS = 4 * 320 * 256
build = partial(room, 1, 'plain')


def renderer(settings: CameraSettings) -> Renderer:
    return Renderer(build(), new_rig(settings))


def started(before):
    return [it for it in multiprocessing.active_children() if it not in before]


@contextmanager
def helped(settings: CameraSettings):
    """Give a renderer that has an assistant of its own, and the process of that."""
    before, together = multiprocessing.active_children(), renderer(settings)
    with Assistant(build, PIXELS) as together.assistant:
        assert together.assistant.wait()
        (process,) = started(before)
        yield together, process


@pytest.fixture(scope='module')
def assistant():
    with Assistant(build, PIXELS) as assistant:
        assert assistant.wait()
        yield assistant


@pytest.fixture
def drawn(monkeypatch):
    """Collect which strips are drawn here."""
    numbers, textured = [], assistant_module.draw_textures

    def watched(scene, raster, image, which=None):
        if which is not None:
            numbers.append((len(raster.strips), which))
        textured(scene, raster, image, which)

    monkeypatch.setattr(assistant_module, 'draw_textures', watched)
    return numbers


@pytest.mark.parametrize('settings', [PINHOLE, BARREL, FISHEYE], ids=['pinhole', 'barrel', 'eye'])
def test_images_are_the_same_with_and_without(assistant, settings, drawn) -> None:
    alone, together = renderer(settings), renderer(settings)
    together.assistant = assistant
    for pose in POSES:
        np.testing.assert_array_equal(together.render(pose), alone.render(pose))
    assert len(drawn) >= len(POSES)
    assert sum(len(which) for _, which in drawn) < 0.9 * sum(count for count, _ in drawn)


def test_an_image_is_drawn_alone_where_the_assistant_has_died(drawn) -> None:
    alone = renderer(PINHOLE)
    with helped(PINHOLE) as (together, process):
        together.render(POSES[0])
        assert len(drawn) == 1
        os.kill(process.pid, signal.SIGKILL)
        for pose in POSES:
            np.testing.assert_array_equal(together.render(pose), alone.render(pose))
    assert not process.is_alive()


@pytest.mark.parametrize('drawn_there', few_of([True, False]))
def test_an_image_is_finished_alone_where_the_assistant_dies_on_the_way(
    drawn_there: bool, drawn, monkeypatch
) -> None:
    """It dies with its share drawn or not, while edges are prepared here."""
    alone, mixing = renderer(PINHOLE), assistant_module.mixing
    with helped(PINHOLE) as (together, process):

        def fatal(scene, view, raster):
            if process.is_alive():
                if drawn_there:
                    assert together.assistant._drawn.acquire(timeout=10.0)
                os.kill(process.pid, signal.SIGKILL)
                process.join()
            return mixing(scene, view, raster)

        monkeypatch.setattr(assistant_module, 'mixing', fatal)
        for pose in POSES:
            np.testing.assert_array_equal(together.render(pose), alone.render(pose))
    (count, here), (_, there) = drawn
    assert here
    assert here | there == set(range(1, count + 1))


def test_an_image_waits_for_a_slow_assistant(drawn) -> None:
    alone = renderer(PINHOLE)
    with helped(PINHOLE) as (together, process):
        os.kill(process.pid, signal.SIGSTOP)
        timer = threading.Timer(0.5, os.kill, (process.pid, signal.SIGCONT))
        timer.start()
        np.testing.assert_array_equal(together.render(POSES[0]), alone.render(POSES[0]))
        timer.join()
    assert len(drawn) == 1


def test_a_view_that_is_too_large_is_drawn_alone(drawn) -> None:
    alone, together = renderer(PINHOLE), renderer(PINHOLE)
    with Assistant(build, 320 * 256 - 1) as small:
        assert small.wait()
        together.assistant = small
        np.testing.assert_array_equal(together.render(POSES[0]), alone.render(POSES[0]))
    assert not drawn


def test_a_share_that_nobody_fetched_is_not_taken_for_another(drawn, monkeypatch) -> None:
    alone = renderer(PINHOLE)
    with helped(PINHOLE) as (together, _):
        with monkeypatch.context() as patch, pytest.raises(KeyError):
            patch.setattr(Assistant, 'finish', lambda *_: {}['interrupted'])
            together.render(POSES[0])
        for pose in POSES[1:]:
            np.testing.assert_array_equal(together.render(pose), alone.render(pose))
    assert len(drawn) == 1


def test_its_end_is_the_end_of_its_process() -> None:
    before = multiprocessing.active_children()
    with Assistant(build, PIXELS) as short:
        (process,) = started(before)
        assert process.is_alive()
        assert short.wait()
    assert process.exitcode == 0


def cost(raster: Raster, number: int) -> int:
    strip, (left, top, right, bottom) = raster.strips[number - 1], raster.boxes[number - 1]
    return STRIP + (right - left) * (bottom - top) * strip.columns * strip.rows


def test_strips_stay_with_who_has_them_and_work_is_as_told() -> None:
    scene, sharing = build(), Sharing()
    kept = changed = 0
    owners: dict[Strip, int] = {}
    for spared, pose in zip((0.0, 0.0, 0.0, 0.6), POSES, strict=True):
        axes, centre = new_rig(PINHOLE).camera_pose(pose)
        raster = rasterize(scene, PinholeView(320, 256, PINHOLE.camera.matrix, centre, axes))
        shares = sharing.shares(raster, spared)
        assert shares[0] | shares[1] == set(range(1, len(raster.strips) + 1))
        assert not shares[0] & shares[1]
        before, owners = owners, {}
        for who, numbers in enumerate(shares):
            for strip in (raster.strips[number - 1] for number in numbers):
                kept += before.get(strip) == who
                changed += before.get(strip, who) != who
                owners[strip] = who
        work = [sum(cost(raster, number) for number in numbers) for numbers in shares]
        assert work[0] / sum(work) == pytest.approx(0.5 - 0.5 * spared, abs=0.1)
    assert changed < 0.3 * kept
