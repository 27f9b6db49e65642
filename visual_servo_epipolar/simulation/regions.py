"""Regions: where a robot may start when it is to come back to the goal."""

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.errors import InputError, TrackingError
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, Pose
from visual_servo_epipolar.core.rigs.rig import Joints
from visual_servo_epipolar.core.tracking.candidates import Candidates
from visual_servo_epipolar.core.tracking.matching import desired_view
from visual_servo_epipolar.simulation.cameras import CameraSettings
from visual_servo_epipolar.simulation.choices import refuse_unknown, REGIONS, StartRegion
from visual_servo_epipolar.simulation.rendering.renderer import Renderer
from visual_servo_epipolar.simulation.rendering.surfaces import Scene
from visual_servo_epipolar.simulation.rigs import SimulatedRig
from visual_servo_epipolar.simulation.rooms.scene import room
from visual_servo_epipolar.simulation.scenario import Scenario
from visual_servo_epipolar.simulation.sensor import CameraMotion
from visual_servo_epipolar.simulation.views import points_of

CLEARANCE = 0.3  # from the middle of the axle to the farthest corner of a Pioneer 3-DX [m]
Start = tuple[float, float, float]
Condition = Callable[[Pose], bool]
TRIES = 5000
LEAST_FEATURES = 40  # of the goal's, in view from a start anywhere


class Ground:
    """
    The floor plan of a scene, for a robot with a camera on it.

    The floor is the lowest level surface of the room; of furniture, each level surface of a body
    that reaches down to the robot is in the way.
    """

    def __init__(self, scene: Scene, rig: SimulatedRig) -> None:
        self._rig = rig
        height = float(rig.camera_pose(DESIRED_POSE).centre[2])
        level = np.abs(scene.normals[:, 2]) > 0.5
        of_room = scene.bodies == 0
        floors = scene.corners[level & of_room]
        self._floors = floors[floors[:, 0, 2] < height]
        lowest = np.array(
            [scene.corners[scene.bodies == k][..., 2].min() for k in scene.bodies.tolist()]
        )
        reaches_down = lowest < height + 0.2  # what hangs higher is no obstacle
        self._obstacles = scene.corners[level & ~of_room & reaches_down]

    def is_free(self, pose: Pose) -> bool:
        """Return whether the robot and its camera can be at ``pose``."""
        x, y, _ = self._rig.camera_pose(pose).centre.tolist()
        return all(
            any(depth >= CLEARANCE for depth in depths(place, self._floors))
            and all(depth <= -CLEARANCE for depth in depths(place, self._obstacles))
            for place in ((pose.x, pose.y), (x, y))
        )


def depths(place: tuple[float, float], rectangles: FloatArray) -> list[float]:
    """
    Return how deep a ``place`` lies in level ``rectangles`` [m]; outside, - distance.

    Rectangles have shape (M, 4, 3): corners, in order around.
    """
    contours = rectangles[..., :2].astype(np.float32)
    return [cv2.pointPolygonTest(contour, place, True) for contour in contours]


def start_in(
    region: str, seed: int, index: int, scenario: Scenario, *, source: str = 'features'
) -> Start:
    """
    Return start number ``index`` of a region: x [m], y [m], heading error [deg].

    It depends on the arguments alone, not on how many starts are drawn. In images no start is in
    a wall or in furniture. ``anywhere`` are all poses from which at least 40 of the goal's
    features are in view: points of the cloud that belongs to the seed of ``scenario``, or what
    the tracker would keep of the photograph, as far as nothing in the room hides it. So is
    ``around``, within 4 m of the goal. A head may be turned to see them.

    Raises InputError if there is no such region, or no such start.
    """
    refuse_unknown('region', region, REGIONS)
    conditions = _conditions(REGIONS[region], scenario, source)
    rng = np.random.default_rng((seed, 8, index))  # 8: apart from other draws of one seed
    for _ in range(TRIES):
        x, y, heading = rng.uniform(*REGIONS[region].box).round(6).tolist()  # as written
        pose = Pose.from_start(x, y, heading)
        if all(holds(pose) for holds in conditions):
            return x, y, heading
    raise InputError(
        f'no start found in region {region} in {TRIES} tries; see that the scene leaves floor '
        f'free and that the goal has more than {LEAST_FEATURES} features'
    )


def _conditions(region: StartRegion, scenario: Scenario, source: str) -> list[Condition]:
    if source == 'features':
        if not region.in_view:
            return []
        world = points_of(scenario, scenario.camera.seed)
        return [
            lambda pose: any(
                int(world.project(pose, motion=CameraMotion(joints=joints))[1].sum())
                >= LEAST_FEATURES
                for joints in world.rig.gazes
            )
        ]
    camera = replace(scenario.camera, seed=0)  # one scene serves all runs
    light = scenario.light.photograph_light
    scenery = _Scenery(camera, light, scenario.tracker.candidates)
    if not region.in_view:
        return [scenery.ground.is_free]
    return [scenery.ground.is_free, scenery.is_seen]


@lru_cache(maxsize=4)
class _Scenery:
    """The room, and the points in it that are worth tracking in a photograph by ``light``."""

    def __init__(self, camera: CameraSettings, light: str, candidates: int) -> None:
        scene, rig = room(camera.scene_seed, camera.scene, light), camera.rig()
        self.ground = Ground(scene, rig)
        # What is kept has no pictures on it: they take hundreds of megabytes.
        self._renderer = Renderer(scene.bare(), rig)
        photograph = Renderer(scene, rig).render(DESIRED_POSE)
        pixels = _worth_tracking(photograph, candidates)
        points = self._renderer.trace(pixels, DESIRED_POSE)
        self._points = points[np.isfinite(points).all(axis=1)]

    def is_seen(self, pose: Pose) -> bool:
        """Return whether enough of the goal's features can be seen, wherever a head looks."""
        return any(self._shows(pose, joints) for joints in self._renderer.rig.gazes)

    def _shows(self, pose: Pose, joints: Joints) -> bool:
        pixels, visible = self._renderer.project(self._points, pose, joints=joints)
        if int(visible.sum()) < LEAST_FEATURES:  # too few even if nothing hides them
            return False
        points = self._points[visible]
        seen = self._renderer.unhidden(points, pixels[visible], pose, joints)
        return int(seen.sum()) >= LEAST_FEATURES


def _worth_tracking(photograph: Image, candidates: int) -> FloatArray:
    """Return the pixels, shape (N, 2), of the features that a tracker would keep as candidates."""
    try:
        view = desired_view(photograph)
    except TrackingError as error:
        raise InputError(f'the scene cannot be used: {error}') from None
    pixels = view.keypoints.pixels
    rows = Candidates(view).bucketed(
        np.arange(len(pixels)), np.zeros(len(pixels), bool), candidates
    )
    return pixels[rows]
