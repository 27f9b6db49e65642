"""Study: synthetic features seen along a spiral and a straight line, and once near the goal."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
import math
from typing import NamedTuple

import numpy as np

from visual_servo_epipolar.core.arrays import BoolArray, FloatArray
from visual_servo_epipolar.core.cameras.pinhole import Camera
from visual_servo_epipolar.core.errors import DegenerateGeometryError
from visual_servo_epipolar.core.geometry.epipolar import Bearings, rotation_desired_current
from visual_servo_epipolar.core.geometry.rays import rotation_level_camera
from visual_servo_epipolar.core.mapping.keyframe_map import KeyframeMap
from visual_servo_epipolar.core.mapping.localization import MapLocalization
from visual_servo_epipolar.core.mapping.window import FeatureObservations, MapSettings
from visual_servo_epipolar.core.twoview.estimator import Attitude, Prior
from visual_servo_epipolar.core.twoview.soft_planar import soft_planar

SMALL = Camera(640, 480, 600.0, 600.0, 319.5, 239.5)
SPIRAL, LINE = 9, 5  # views
START, CHI, ALPHA = 3.5, math.radians(10.0), math.radians(8.0)


@dataclass(frozen=True, kw_only=True)
class StudySettings:
    """
    Conditions of the study.

    ``wall`` is one wall at 5 m with 4 % relief instead of a room, 3-8 m deep; ``noise`` of a
    coordinate [px]; ``wrong``, the share of features that the photograph shows elsewhere, and
    ``slips`` of single ones; ``jitter`` of tilt and roll [rad], ``scale_error`` of the way;
    ``tilt`` of the camera and what is not known of tilt and roll [rad].
    """

    points: int = 60
    wall: bool = False
    noise: float = 0.2
    wrong: float = 0.05
    slips: float = 0.0
    jitter: float = math.radians(0.1)
    scale_error: float = 0.05
    tilt: float = 0.0
    tilt_deviation: float = math.radians(2.0)
    camera: Camera = SMALL


@dataclass(frozen=True, eq=False)
class StudyTrial:
    """
    One drive: true ``views``, (V, 5), the last near the goal, and what they show.

    ``features``, (N, 3), stand in upright axes of the photograph, whose ``attitude``, (2,), is
    drawn like that of the views. ``pixels``, (V + 1, N, 2), of the photograph and the views, are
    in the image where ``seen``, (V, N); ``right``, (V, N), are those that are no wrong matches.
    """

    settings: StudySettings
    views: FloatArray
    features: FloatArray
    attitude: FloatArray
    pixels: FloatArray
    seen: BoolArray
    right: BoolArray
    scale: float

    def observations(self, k: int) -> FeatureObservations:
        """Return what view ``k`` shows, wrong matches with the rest."""
        ids = np.flatnonzero(self.seen[k])
        camera = self.settings.camera
        current, desired = (camera.rays(self.pixels[j, ids]) for j in (k % len(self.views) + 1, 0))
        noise = [self.settings.noise * camera.resolution(each) for each in (current, desired)]
        return FeatureObservations(ids, current, desired, np.stack(noise, axis=1))

    def motion(self, k: int) -> FloatArray:
        """Return the way to view ``k`` from the one before, in axes there, as it was told [m]."""
        if k == 0:
            return np.zeros(2)
        before, now = self.views[k - 1], self.views[k]
        across = self.scale * (now[:2] - before[:2])
        cosine, sine = math.cos(before[2]), math.sin(before[2])
        return np.asarray(np.array([[cosine, sine], [-sine, cosine]]) @ across)

    @property
    def mount(self) -> Attitude:
        """What is known of the camera beforehand."""
        deviation = self.settings.tilt_deviation
        return Attitude(0.0, 0.0, deviation, deviation, self.settings.jitter)


def path(rng: np.random.Generator) -> FloatArray:
    """Return places and headings of the views, (V, 3): a spiral, a line, a view at the goal."""
    chi = CHI * np.linspace(1.0, 0.0, SPIRAL)
    distance = START * np.exp((chi - CHI) / math.tan(ALPHA))
    spiral = np.column_stack([distance * np.sin(chi), -distance * np.cos(chi), chi + ALPHA])
    ahead = distance[-1] * np.linspace(1.0, 0.1, LINE)
    line = np.column_stack([np.zeros(LINE), -ahead, np.zeros(LINE)])
    near = [rng.uniform(-0.005, 0.005), rng.uniform(-0.02, 0.0), rng.uniform(-0.004, 0.004)]
    views = np.vstack([spiral, line, near])
    views[SPIRAL:-1, [0, 2]] += rng.normal(size=(LINE, 2)) * [0.003, 0.003]
    return views


def features(settings: StudySettings, rng: np.random.Generator) -> FloatArray:
    """Return features, (N, 3), that the photograph shows, in its axes."""
    count, camera = settings.points, settings.camera
    pixels = rng.uniform([5.0, 5.0], [camera.width - 6.0, camera.height - 6.0], (count, 2))
    relief = rng.uniform(-1.0, 1.0, count)
    depth = 5.0 * (1.0 + 0.04 * relief) if settings.wall else 5.5 + 2.5 * relief
    rays = camera.rays(pixels)
    return np.asarray(rays / rays[:, 2:] * depth[:, None])


def seen_from(points: FloatArray, view: FloatArray) -> FloatArray:
    """Return upright ``points``, (N, 3), in axes of the camera of a ``view``, (5,)."""
    x, y, heading, tilt, roll = view.tolist()
    upright = (points - [x, 0.0, y]) @ rotation_desired_current(heading)
    return np.asarray(upright @ rotation_level_camera(tilt, roll))


def trial(settings: StudySettings, seed: int, places: FloatArray | None = None) -> StudyTrial:
    """Return one drive, also along other ``places``, (V, 3); ``seed`` draws all that is chance."""
    # What more views draw must not change what was drawn for others.
    scene, floor, noise, slip = (np.random.default_rng((seed, part)) for part in range(4))
    camera, usual = settings.camera, path(scene)
    places = usual if places is None else places
    points = features(settings, scene)
    wrong = scene.permutation(settings.points)[: round(settings.wrong * settings.points)]
    elsewhere = scene.uniform([0.0, 0.0], [camera.width, camera.height], (len(wrong), 2))
    scale = 1.0 + settings.scale_error * scene.normal()
    attitudes = settings.jitter * floor.normal(size=(len(places) + 1, 2)) + [settings.tilt, 0.0]
    views = np.column_stack([places, attitudes[1:]])
    points = points @ rotation_level_camera(*attitudes[0]).T
    photograph = np.concatenate([np.zeros(3), attitudes[0]])
    shown = [seen_from(points, view) for view in (photograph, *views)]
    pixels = np.stack([camera.pixels(each) for each in shown])
    pixels = pixels + settings.noise * noise.normal(size=pixels.shape)
    pixels[0, wrong] = elsewhere
    seen = camera.contains(pixels[1:].reshape(-1, 2)).reshape(len(views), -1)
    slipped = slip.random(seen.shape) < settings.slips
    pixels[1:][slipped] = slip.uniform(0.0, camera.height, (int(slipped.sum()), 2))
    right = ~slipped
    right[:, wrong] = False
    return StudyTrial(settings, views, points, attitudes[0], pixels, seen, right, scale)


class TwoViewBearings(NamedTuple):
    """What photograph and one view alone say, with the alternative if there is one."""

    bearings: tuple[Bearings, ...] = ()
    attitude: Attitude | None = None


def two_views(trial: StudyTrial, k: int) -> TwoViewBearings:
    """Return what photograph and view ``k`` alone say: nothing where they cannot."""
    observations = trial.observations(k)
    try:
        estimate = soft_planar(
            observations.current,
            observations.desired,
            noise=observations.noise,
            prior=Prior(trial.mount, mount=trial.mount),
            rng=np.random.default_rng(0),
        )
    except DegenerateGeometryError:
        return TwoViewBearings()
    other = () if estimate.alternative is None else (estimate.alternative,)
    return TwoViewBearings((estimate.bearings, *other), estimate.attitude)


def mapped(
    trial: StudyTrial,
    settings: MapSettings | None = None,
    *,
    told: Callable[[StudyTrial, int], TwoViewBearings] = two_views,
) -> Iterator[tuple[KeyframeMap, MapLocalization | None]]:
    """Yield memory and localization after each view; two views are ``told`` until it begins."""
    memory = KeyframeMap(trial.mount, settings or MapSettings())
    for k in range(len(trial.views)):
        start = told(trial, k) if memory.geometry is None else TwoViewBearings()
        observations, motion = trial.observations(k), trial.motion(k)
        memory, said = memory.after(observations, motion, **start._asdict())
        memory = memory.update_map()
        yield memory, said


def map_after_drive(trial: StudyTrial) -> KeyframeMap:
    """Return the memory after all views but the last."""
    *_, (memory, _), _ = mapped(trial)
    return memory
