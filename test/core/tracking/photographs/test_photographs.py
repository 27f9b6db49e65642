"""Which photographs are kept, and when a whole image is matched anew."""

from dataclasses import replace
import math

import cv2
import numpy as np
import pytest
from small_cameras import sized

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.goal import goal_id
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.tracking.photographs import (
    at_rest,
    averaged,
    Rematching,
    superfluous,
    unrest,
)
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator, ImageView
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.closed_loop import Loop, LoopSettings
from visual_servo_epipolar.simulation.light import LightSettings

TEXTURE = np.random.default_rng(1).uniform(0.7, 1.0, (96, 128))
ACROSS, DOWN = np.meshgrid(np.linspace(0.1, 1.0, 128), np.linspace(0.1, 1.0, 96))
LIGHTS = {'all': 0.0 * DOWN + 1.0, 'left': ACROSS[:, ::-1], 'right': ACROSS, 'above': DOWN}
LIGHTS['faint'] = 0.3 * LIGHTS['left']


def lit(light: str) -> Image:
    return (200.0 * LIGHTS[light] * TEXTURE).astype(np.uint8)


@pytest.mark.parametrize(
    ('lights', 'most', 'out'),
    [
        (['all'], 1, None),
        (['all', 'left'], 2, None),
        (['all', 'left'], 1, 1),  # the first always stays
        (['all', 'left', 'right', 'left'], 4, 3),  # of a light that is there
        (['all', 'left', 'above', 'right'], 4, None),
        (['all', 'left', 'faint'], 4, 2),  # another exposure is no other light
    ],
)
def test_of_photographs_those_stay_whose_light_differs(lights, most, out) -> None:
    assert superfluous([lit(light) for light in lights], most) == out


def test_of_too_many_the_older_of_the_two_most_alike_goes() -> None:
    between = (0.5 * lit('left') + 0.5 * lit('above')).astype(np.uint8)
    images = [lit('right'), lit('above'), lit('left'), between]
    assert superfluous(images, 4) is None
    assert superfluous(images, 3) in (1, 2)


def test_an_image_is_matched_anew_at_once_where_nothing_is_known_and_sooner_with_few() -> None:
    rematching = Rematching()
    assert rematching.is_due(0, period=11)
    rematching._elapsed = 0
    due = []
    for left in (30, 30, 30, 10):
        rematching.pass_frame()
        due.append(rematching.is_due(left, period=11))
    assert due == [False, False, False, True]
    rematching.forget()
    assert rematching.is_due(60, period=11)


SIZE = 240, 320
NOISE = 2.0


@pytest.fixture(scope='module')
def scene() -> np.ndarray:
    """Return grey levels of a textured scene."""
    rough = np.random.default_rng(0).uniform(0.0, 255.0, SIZE)
    smooth = cv2.GaussianBlur(rough, (0, 0), 2.0)
    return np.clip(110.0 + 4.0 * (smooth - smooth.mean()), 0.0, 255.0)


def taken(scene: np.ndarray, seed: int, *, noise: float = NOISE) -> np.ndarray:
    rng = np.random.default_rng(seed)
    noisy = scene + rng.normal(0.0, noise, SIZE)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def shifted(scene: np.ndarray, px: float, zoom: float = 0.0) -> np.ndarray:
    """Return the scene moved by ``px``; by a ``zoom`` at its left and right border alone."""
    affine = cv2.getRotationMatrix2D((159.5, 119.5), 0.0, 1.0 + zoom * px / 160.0)
    affine[0, 2] += px * (not zoom)
    kind = {'flags': cv2.INTER_CUBIC, 'borderMode': cv2.BORDER_REPLICATE}
    return cv2.warpAffine(scene, affine, SIZE[::-1], **kind)


def test_a_mean_is_rounded_and_has_less_noise_by_the_root_of_its_images(scene) -> None:
    one, mean = taken(scene, 0), averaged([taken(scene, seed) for seed in range(16)])
    assert averaged([one]) is one and mean.dtype == np.uint8
    rounding = 1.0 / 12.0
    noise = np.std(one - scene), np.std(mean - scene)
    assert noise[1] == pytest.approx(np.sqrt((noise[0] ** 2 - rounding) / 16 + rounding), rel=0.1)
    bright = [np.full((4, 4), level, np.uint8) for level in (255, 255, 254)]
    assert (averaged(bright) == 255).all()


@pytest.mark.parametrize('noise', [0.0, 0.5, 2.0, 8.0])
def test_noise_is_no_motion(scene, noise) -> None:
    images = [taken(scene, seed, noise=noise) for seed in range(12)]
    assert at_rest(images) == (12, '')


@pytest.mark.parametrize('noise', [0.0, 2.0, 8.0])
@pytest.mark.parametrize('zoom', [0.0, 1.0])
def test_half_a_pixel_is_motion_in_any_noise(scene, zoom, noise) -> None:
    moved = taken(shifted(scene, 0.5, zoom), 1, noise=noise)
    reason = unrest(taken(scene, 0, noise=noise), moved)
    assert reason.startswith('the view moves by 0.')


def test_a_walker_is_unrest_and_what_blurs_less_than_tracking_errs_or_light_is_not(scene) -> None:
    walker = scene.copy()
    walker[40:200, 100:140] = 20.0
    assert unrest(taken(scene, 0), taken(walker, 1)).endswith('of the view changes')
    for still in (shifted(scene, 0.03), 0.95 * scene + 5.0):
        assert unrest(taken(scene, 0), taken(still, 1)) == ''


@pytest.mark.parametrize('quality', [80, 30])
def test_compression_is_no_motion(scene, quality) -> None:
    def packed(image):
        return cv2.imdecode(cv2.imencode('.jpg', image, [1, quality])[1], 0)

    assert at_rest([packed(taken(scene, seed)) for seed in range(8)]) == (8, '')


def test_images_count_back_to_the_last_motion(scene) -> None:
    still = [taken(scene, seed) for seed in range(5)]
    count, reason = at_rest([*still, taken(shifted(scene, 2.0), 9), *still])
    assert (count, reason[:14]) == (5, 'the view moves')


@pytest.mark.parametrize('shape', [(1, 1), (2, 9), (3, 3), (16, 16)])
def test_images_of_any_size_and_none_in_them_are_compared(shape) -> None:
    blank = np.zeros(shape, np.uint8)
    assert at_rest([blank, blank, np.full(shape, 9, np.uint8)]) == (3, '')
    assert at_rest([blank, np.zeros((20, 20), np.uint8)]) == (1, 'their sizes differ')


CAMERA = CameraSettings(**sized(640, 480, 384.6, 319.5, 239.5))
NEAR = Pose(0.1, -1.0, DESIRED_POSE.theta)


@pytest.fixture(scope='module')
def dusk() -> CameraSimulator:
    """Return a room of which the photograph is from noon, and all else from dusk."""
    light = LightSettings(photograph_light='noon', light='dusk', exposure='auto')
    return CameraSimulator(CAMERA, None, light)


@pytest.fixture(scope='module')
def evening(dusk: CameraSimulator) -> np.ndarray:
    """Return a photograph from dusk, taken where a robot arrived."""
    return dusk.capture(Pose(0.001, -0.001, DESIRED_POSE.theta + math.radians(0.02)), 0)


def tracker_of(*photographs: np.ndarray) -> Tracker:
    """Return a tracker that knows these photographs of one pose."""
    tracker = Tracker(TrackerSettings())
    tracker.set_desired(photographs[0])
    for each in photographs[1:]:
        tracker.add_desired(each)
    return tracker


@pytest.fixture(scope='module')
def both(dusk: CameraSimulator, evening: np.ndarray) -> Tracker:
    """Return a tracker that knows both photographs."""
    return tracker_of(dusk.photograph(), evening)


@pytest.fixture
def taught(both: Tracker) -> Tracker:
    """Return that tracker, to begin anew."""
    both.redetect()
    return both


def test_the_photograph_in_todays_light_is_tracked_to_where_the_first_was(dusk, taught) -> None:
    alone = tracker_of(dusk.photograph())
    features = taught.track(dusk.capture(NEAR, 1))
    assert taught.which == 'photograph 2 of 2'
    assert len(features) >= len(alone.track(dusk.capture(NEAR, 1)))
    assert features.goal == alone.goal.id
    truth, _ = dusk.renderer.project(dusk.renderer.trace(features.current, NEAR), DESIRED_POSE)
    off = features.desired - truth
    assert np.abs(np.median(off, axis=0)).max() < 0.03  # a third of a millimetre at 3 m
    dusk.relight(replace(dusk.light, light='noon'))
    taught.redetect()
    ids = taught.track(dusk.capture(NEAR, 2)).ids
    dusk.relight(replace(dusk.light, light='dusk'))
    assert taught.which == 'photograph 1 of 2'
    assert not set(ids) & set(features.ids)  # an id is one point of one photograph


def test_light_that_changes_on_the_way_changes_the_photograph(dusk, taught) -> None:
    taught.track(dusk.capture(NEAR, 1))
    blind = np.full((480, 640), 128, np.uint8)
    for _ in range(3):
        taught.track(blind)
    dusk.relight(replace(dusk.light, light='noon'))
    for frame in range(12):
        features = taught.track(dusk.capture(NEAR, frame))
    dusk.relight(replace(dusk.light, light='dusk'))
    assert len(features) >= 30
    assert taught.which == 'photograph 1 of 2'


@pytest.mark.parametrize(
    ('x', 'heading', 'reason'),
    [
        (0.2, 0.0, 'from another pose than the first'),
        (0.0, 5.0, 'from another pose than the first'),
        (0.0, 180.0, 'does not show what the first'),
    ],
)
def test_a_photograph_of_another_pose_is_refused(dusk, taught, x, heading, reason) -> None:
    elsewhere = dusk.capture(Pose(x, 0.0, DESIRED_POSE.theta + math.radians(heading)), 0)
    photographs = taught.photographs
    with pytest.raises(TrackingError, match=reason):
        taught.add_desired(elsewhere)
    assert taught.photographs is photographs


def test_a_further_photograph_needs_a_first_one_of_its_size(taught, evening) -> None:
    with pytest.raises(ValueError, match='no desired image yet'):
        Tracker(TrackerSettings()).add_desired(evening)
    with pytest.raises(ValueError, match='must have the size of the first, 640x480, got 600x480'):
        taught.add_desired(evening[:, :600])


DAY = 'noon', 'dusk', 'lamp_right', 'lamp_side', 'dark'


@pytest.mark.parametrize(
    ('lights', 'times'), [(DAY[1::3], 1), pytest.param(DAY, 20, marks=pytest.mark.long)]
)
def test_arrivals_through_a_day_of_light_do_not_move_the_goal(dusk, lights, times) -> None:
    view, rng = ImageView(dusk, Tracker(TrackerSettings())), np.random.default_rng(1)
    tracker, light = view.tracker, dusk.light
    for arrival, now in enumerate(np.repeat(lights, times)):
        dusk.relight(replace(light, light=str(now)))
        tracker.redetect()
        start = rng.uniform(-0.2, 0.2), rng.uniform(-1.0, -0.7), rng.uniform(-4.0, 4.0)
        settings = LoopSettings(start=start, seed=arrival, servo=ServoSettings(law='smooth'))
        log = Loop(settings, view, dusk.camera).run()
        end = log.samples[-1].pose
        assert math.hypot(end.x, end.y) < 0.003
        if (now, arrival % times) == ('dusk', 1):
            assert tracker.which.startswith('photograph 2')
        tracker.renew(averaged([dusk.capture(end, 1000 + k) for k in range(10)]), 4)
    dusk.relight(light)
    assert len(tracker.photographs) == min(1 + len(set(lights) - {'noon'}), 4)
    assert tracker.goal.id == goal_id(dusk.photograph())


def test_ids_of_a_photograph_follow_from_it(dusk, evening, both) -> None:
    again = tracker_of(dusk.photograph(), evening)
    first, second = (each.photographs.views[1].first_id for each in (again, both))
    assert first == second > len(both.photographs.views[0].first_pixels)
