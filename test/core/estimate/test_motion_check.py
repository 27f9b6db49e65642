"""The base moves as it was told, or the run is held."""

from collections.abc import Callable, Iterator
from dataclasses import replace
import math
from typing import Any

import numpy as np
import pytest
from servo_states import SETTINGS, sight

from visual_servo_epipolar.core.estimate.base_model import (
    Curvature,
    MOST_CONTRADICTIONS,
    MOST_CURVATURE,
)
from visual_servo_epipolar.core.estimate.motion_check import (
    Evidence,
    MotionCheck,
)
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.odometry.commands_sent import CommandsSent
from visual_servo_epipolar.core.rigs.pan_tilt import PanTiltHead
from visual_servo_epipolar.core.rigs.rig import HeadLimits, HeadView, Joints
from visual_servo_epipolar.core.stamps import MOST_GAP_S
from visual_servo_epipolar.core.twoview.observation import Observation

PERIOD_S, NOISE = 0.1, 4e-4  # 0.3 px at 769 px
HEAD = PanTiltHead(HeadLimits())
STILL, TURN, AHEAD = STANDSTILL, Twist(0.0, 0.3), Twist(0.3, 0.0)
Motion = Callable[[float], float]  # by the time since the beginning [s]


def nowhere(time_s: float) -> float:
    return 0.0


def points(seed: int = 0, *, depth: tuple[float, float] = (3.0, 8.0)) -> np.ndarray:
    """Return a scene in front of the camera, (60, 3) [m]."""
    rng = np.random.default_rng(seed)
    rays = np.column_stack([rng.uniform(-0.7, 0.7, (60, 2)), np.ones(60)])
    return rays * rng.uniform(*depth, (60, 1))


def view(time_s: float, turn: float, way: float, scene: np.ndarray, flip: float) -> Observation:
    """Return what is seen after a ``turn`` to the left [rad] and a ``way`` ahead [m]."""
    cosine, sine = math.cos(turn), math.sin(turn)
    axes = np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
    rays = (scene - [0.0, 0.0, way]) @ axes
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    rng = np.random.default_rng(round(1000 * time_s))
    rays = rays * [flip, 1.0, 1.0] + NOISE * rng.standard_normal(rays.shape)
    return Observation(
        round(1e9 * time_s), rays, rays, 769.0, ids=np.arange(len(rays)), pixel_angles=None
    )


def checks(
    seen: Callable[[float], Observation],
    twist: Callable[[float], Twist] = lambda time_s: STILL,
    *,
    seconds: float = 4.0,
    parallax_of_way: float = 0.03,
    dead_band: Motion = nowhere,
) -> Iterator[tuple[float, MotionCheck]]:
    """Yield time [s] and check of each image; ``dead_band`` is what is known by then [rad/s]."""
    check, sent = MotionCheck(), CommandsSent()
    for frame in range(1, round(seconds / PERIOD_S)):
        time_s = frame * PERIOD_S
        here = seen(time_s)
        settings = replace(SETTINGS, dead_band_angular=dead_band(time_s))
        evidence = Evidence(here, NOISE, parallax_of_way)
        check = check.updated(evidence, sent, settings, drives=True)
        yield time_s, check
        sent = sent.after(here.stamp_ns, twist(time_s))


def troubles(
    twist: Callable[[float], Twist],
    turn: Motion,
    way: Motion = nowhere,
    *,
    seconds: float = 8.0,
    flip: float = 1.0,
    scene: np.ndarray | None = None,
    **known: Any,
) -> list[tuple[float, str]]:
    """Return when something contradicted the commands [s], and in which words."""
    scene = points() if scene is None else scene

    def seen(time_s: float) -> Observation:
        return view(time_s, turn(time_s), way(time_s), scene, flip)

    checked = checks(seen, twist, seconds=seconds, **known)
    return [(time_s, check.trouble) for time_s, check in checked if check.trouble]


def slips(
    encoder: Motion,
    *,
    turn: Motion = nowhere,
    pan: Motion = nowhere,
    twist: Twist = STILL,
    noise: float = 0.0,
    seconds: float = 4.0,
) -> list[float]:
    """
    Return when a run with a head ends [s], of which ``encoder`` is what it is wrong by [rad].

    The joint says that it is at ``pan`` [rad].
    """
    rng, scene = np.random.default_rng(5), points()

    def seen(time_s: float) -> Observation:
        wrong = noise * rng.standard_normal()
        here = view(time_s, turn(time_s) + encoder(time_s) + wrong, 0.0, scene, 1.0)
        return replace(here, head=HeadView(Joints(pan(time_s) + wrong), here.edges, HEAD))

    checked = checks(seen, lambda time_s: twist, seconds=seconds)
    return [time_s for time_s, check in checked if check.trouble and check.is_final]


@pytest.mark.parametrize('size', [-0.2, -0.05, 0.04, 0.1])
@pytest.mark.parametrize('rate', [0.0, 0.3])
def test_an_encoder_of_a_head_that_slips_ends_the_run(size: float, rate: float) -> None:
    def slip(time_s: float) -> float:
        return size if time_s > 2.05 else 0.0

    size *= 1.0 + 2.0 * rate  # a turn may itself be larger than commanded
    found = slips(slip, pan=slip, turn=late(rate, 0.0), twist=Twist(0.0, rate))
    assert found[0] == pytest.approx(2.2)
    assert len(found) == 18  # for good


def test_features_that_leap_to_a_place_that_looks_alike_are_no_slip_of_the_encoder() -> None:
    """It ended the run: the photograph's poster came into view beside its replica."""

    def seen(time_s: float) -> Observation:
        elsewhere = time_s > 1.55
        here = view(time_s, 0.6 * elsewhere, 0.4 * elsewhere, points(), 1.0)
        return replace(here, head=HeadView(Joints(0.0), here.edges, HEAD))

    checked = list(checks(seen, seconds=3.0))
    assert not any(check.trouble for _, check in checked)
    anew = [round(time_s, 1) for time_s, check in checked if check.head.previous is None]
    assert anew == [1.6]


def test_an_encoder_that_slips_little_by_little_ends_the_run() -> None:
    assert slips(lambda time_s: 0.1 * max(time_s - 1.0, 0.0))


@pytest.mark.parametrize('noise', [0.0005, 0.005, 0.01])
def test_a_noisy_encoder_of_a_head_ends_no_run(noise: float) -> None:
    assert not slips(nowhere, noise=noise, seconds=40.0)


def test_a_single_wrong_reading_of_a_head_ends_no_run() -> None:
    assert not slips(lambda time_s: 0.08 if 2.05 < time_s < 2.15 else 0.0)


@pytest.mark.parametrize('apart', [-0.03, 0.03])
def test_stamps_of_a_head_that_are_apart_from_those_of_images_end_no_run(apart: float) -> None:
    def pan(time_s: float) -> float:
        return 1.5 * min(max(time_s - 1.0, 0.0), 0.5)

    assert not slips(lambda time_s: pan(time_s + apart) - pan(time_s), pan=pan)


def test_a_camera_that_no_head_turns_holds_where_it_is_pushed() -> None:
    found = troubles(lambda time_s: STILL, lambda time_s: 0.2 if time_s > 2.05 else 0.0)
    assert [round(time_s, 1) for time_s, _ in found] == [2.2]


def late(rate: float, delay: float) -> Motion:
    """Return a motion at a ``rate`` that begins ``delay`` [s] late."""
    return lambda time_s: rate * max(time_s - delay - PERIOD_S, 0.0)


@pytest.mark.parametrize('delay', [0.0, 0.3, 0.8, 1.5])
@pytest.mark.parametrize('share', [0.5, 0.8, 1.0, 1.5])
def test_a_base_that_obeys_late_or_with_worn_wheels_is_not_held(delay, share) -> None:
    moved = late(0.3 * share, delay)
    assert troubles(lambda time_s: TURN, moved, seconds=4.0) == []
    assert troubles(lambda time_s: AHEAD, nowhere, moved, seconds=4.0) == []


def pulses(time_s: float) -> Twist:
    return Twist(0.0, 0.13) if round(time_s / PERIOD_S) % 10 == 0 else STILL


# Creeping commands that a dead band swallows, and then a way that takes 1.4 s to begin; or before.
CREEP, FAST = Twist(0.0, 0.002), Twist(0.4, 0.0)


@pytest.mark.parametrize(
    ('twist', 'way', 'known'),
    [
        # A dead band is learnt in some three seconds.
        *(
            pytest.param(lambda _, it=it: it, nowhere, {'seconds': 3.0}, id=f'a dead band, {it}')
            for it in (Twist(0.0, 0.02), Twist(0.0, 0.05), Twist(0.02, 0.0), Twist(0.05, 0.0))
        ),
        pytest.param(pulses, nowhere, {'seconds': 6.0}, id='pulses that add up to nothing'),
        pytest.param(
            lambda time_s: CREEP if time_s < 4.0 else FAST,
            lambda time_s: 0.4 * max(time_s - 5.5, 0.0),
            {'seconds': 7.0},
            id='late, and hardly commanded anything before',
        ),
        pytest.param(
            lambda time_s: FAST if time_s < 2.0 else CREEP,
            lambda time_s: 0.4 * min(time_s, 2.0),
            {},
            id='small commands after it stands as commanded',
        ),
        *(
            pytest.param(
                lambda time_s: AHEAD,
                late(0.3, 0.1),
                {'parallax_of_way': shown, 'scene': points(depth=(3000.0, 8000.0))},
                id=f'a way that cannot be seen, {shown}',
            )
            for shown in (0.0, 1e-3)  # as far away as the horizon, or there already
        ),
    ],
)
def test_what_is_no_disobedience(twist, way, known) -> None:
    assert troubles(twist, nowhere, way, **known) == []


def tried(time_s: float) -> float:
    """Return a dead band [rad/s] that is tried before a base is said not to follow."""
    return 0.03 * math.floor(min(time_s, 6.0) / 2.0)


@pytest.mark.parametrize(
    ('twist', 'turn', 'known', 'between'),
    [
        *((it, nowhere, {}, (1.5, 3.0)) for it in (TURN, AHEAD, Twist(-0.2, 0.0))),
        (Twist(0.0, -0.15), nowhere, {}, (1.5, 3.0)),
        (TURN, lambda time_s: 0.3 * min(time_s, 3.0), {}, (3.0, 6.0)),  # it stops in mid way
        (Twist(0.0, 0.05), nowhere, {'seconds': 10.0}, (3.0, 5.0)),  # slow commands
        # 3.0 s of commands without a new dead band
        (Twist(0.0, 0.06), nowhere, {'seconds': 12.0, 'dead_band': tried}, (8.5, 11.0)),
    ],
)
def test_a_base_that_does_not_follow_is_found_out_in_time(twist, turn, known, between) -> None:
    time_s, words = troubles(lambda _: twist, turn, **known)[0]
    assert between[0] < time_s <= between[1]
    assert words.startswith('the base does not follow')


def test_of_who_never_followed_no_turn_is_said_that_nobody_commanded() -> None:
    def twist(time_s: float) -> Twist:
        return AHEAD if time_s < 2.5 else Twist(0.004, 0.0)

    _, (_, second) = troubles(twist, nowhere, seconds=10.0)[:2]
    assert 'a slow motion was commanded' in second


@pytest.mark.parametrize('commanded', [STILL, AHEAD, TURN, Twist(0.0, -0.3)])
@pytest.mark.parametrize('rate', [-0.5, 0.5])
def test_somebody_else_who_turns_the_robot_is_found_out(commanded: Twist, rate: float) -> None:
    found = troubles(
        lambda time_s: commanded,
        lambda time_s: commanded.angular * min(time_s, 2.0) + rate * max(time_s - 2.0, 0.0),
        lambda time_s: commanded.linear * time_s,
        seconds=4.0,
    )
    along = commanded.angular * rate > 0.0  # within what such a base may do
    assert bool(found) is not along
    if found:
        assert 2.0 < found[0][0] <= 3.0


def test_who_is_carried_while_it_is_to_stand_is_found_out() -> None:
    found = troubles(lambda time_s: STILL, nowhere, lambda time_s: 0.2 * max(time_s - 2.0, 0.0))
    assert 2.0 < found[0][0] < 5.0
    assert 'no motion is commanded' in found[0][1]


@pytest.mark.parametrize('rate', [0.1, 0.3, -0.5])
def test_an_image_that_turns_against_the_command_is_found_out_after_some_degrees(rate) -> None:
    found = troubles(
        lambda time_s: Twist(0.0, rate), lambda time_s: rate * time_s, flip=-1.0, seconds=3.0
    )
    time_s, words = found[0]
    assert words.startswith('the image turns against the command')
    assert abs(rate * time_s) < math.radians(10.0)


def test_moving_people_and_wrong_matches_move_no_robot() -> None:
    rng, scene = np.random.default_rng(1), points()

    def seen(time_s: float) -> Observation:
        passing = scene + (rng.random((60, 1)) < 0.2) * rng.uniform(-1.0, 1.0, (60, 3))
        return view(time_s, 0.0, 0.0, passing, 1.0)

    assert not any(check.trouble for _, check in checks(seen))


def test_a_view_that_has_few_features_in_common_with_the_reference_tells_nothing() -> None:
    def seen(time_s: float) -> Observation:
        here = view(time_s, 0.5 * (time_s > 0.15), 0.0, points(), 1.0)
        return replace(here, ids=here.ids + 45 * (time_s > 0.15))

    checked = [check for _, check in checks(seen, seconds=0.4)]
    assert not any(check.trouble for check in checked)
    assert checked[-1].reference.stamp_ns == 200_000_000


def test_the_run_goes_on_when_it_is_quiet_and_ends_at_the_third_time() -> None:
    check = MotionCheck(troubled_ns=10**9, contradictions=1)
    assert check.disturbed(10**9 + round(0.9e9 * MOST_GAP_S))
    assert not check.disturbed(10**9 + round(1.1e9 * MOST_GAP_S))
    assert not check.is_final
    assert MotionCheck(contradictions=MOST_CONTRADICTIONS).is_final


def test_no_wheels_are_as_unequal_as_a_stranger_makes_them_look() -> None:
    curvature = Curvature()
    for frame in range(60):
        before, after = (
            sight(frame + k, heading_error=0.05 * (frame + k), deviation=1e-3) for k in range(2)
        )
        curvature = curvature.updated(before, after, Twist(0.3, 0.0), 0.1, drift=0.05)
    assert curvature.value == MOST_CURVATURE


def learnt_turn(*, unrest: float, frames: int = 1) -> float:
    """Return the curvature after a straight metre that turned, ``frames`` after ``unrest``."""
    curvature = Curvature(change=unrest)
    for frame in range(frames):
        before = sight(frame, heading_error=0.0)
        after = sight(frame + 1, heading_error=0.002 if frame == frames - 1 else 0.0)
        travel = Twist(0.4 if frame == frames - 1 else 0.0, 0.0)
        curvature = curvature.updated(before, after, travel, 0.1, drift=0.01)
    return curvature.value


def test_the_unrest_of_a_command_that_changes_decays_by_half_in_a_frame() -> None:
    halved = learnt_turn(unrest=0.1)
    assert learnt_turn(unrest=0.2, frames=2) == pytest.approx(halved, rel=0.05)


def test_the_unrest_of_a_change_counts_for_a_fifth_of_a_second() -> None:
    # gain = P s / (P s^2 + (0.2 change)^2): with s = 0.04 m, P = 0.0025, change = 0.5 rad/s.
    gain = 0.0025 * 0.04 / (0.0025 * 0.04**2 + 0.1**2 + 2.0 * 5e-4**2)
    off = Curvature().updated(
        sight(0, heading_error=0.0), sight(1, heading_error=0.15), Twist(0.4, 0.5), 0.1, drift=0.0
    )
    assert off.value == pytest.approx(gain * 0.1, rel=0.05)
