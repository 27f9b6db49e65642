"""Structure: where a view is among the features of a key view, also where some were moved."""

import numpy as np
import pytest
from routes import CAMERA as SMALL
from routes import key_view

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.cameras.registry import calibrated_camera
from visual_servo_epipolar.core.routes.key_view_tracker import KeyViewTracker
from visual_servo_epipolar.core.routes.places import _located, CERTAIN
from visual_servo_epipolar.core.routes.structure import Localizer, LocalStructure, ViewPose
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.matching import CurrentView

CAMERA = calibrated_camera(
    (640, 480), (385.0, 0.0, 319.5, 0.0, 385.0, 239.5, 0.0, 0.0, 1.0), (), 'plumb_bob'
)
# A cabinet 2.5 m ahead, and the walls around it: right, down, ahead [m].
CABINET = np.random.default_rng(1).uniform((-0.9, -0.8, 2.4), (-0.5, 0.8, 2.7), (32, 3))
WALLS = np.random.default_rng(2).uniform((-1.2, -1.0, 4.0), (1.5, 0.5, 7.0), (14, 3))
SHIFT = np.array([0.0, 0.0, 0.14])  # of the cabinet along its wall [m]
THERE = np.array([0.3, 0.05, 0.02])


def placed(taught: FloatArray, today: FloatArray) -> ViewPose | None:
    """Return where a camera THERE seems to be, by points, (N, 3), as taught and as today."""
    depths = np.linalg.norm(taught, axis=1)
    covariance = np.repeat(np.diag([0.1, 0.1, 1e-6])[:, :, None], len(taught), axis=2)
    structure = LocalStructure(
        pixels_of(taught),
        np.zeros((2, len(taught))),
        1.0 / depths,
        covariance,
        np.zeros(5),
        0.002,
        0.1,
    )
    x, y, turn = THERE.tolist()
    away = today - [-y, 0.0, x]
    cos, sin = np.cos(turn), np.sin(turn)
    seen = away @ np.array([[cos, 0.0, -sin], [0.0, 1.0, 0.0], [sin, 0.0, cos]])
    return Localizer(structure, CAMERA).locate(
        np.arange(len(taught)), pixels_of(seen), np.zeros(3)
    )


def pixels_of(points: FloatArray) -> FloatArray:
    return np.asarray(385.0 * points[:, :2] / points[:, 2:] + [319.5, 239.5])


def test_a_view_is_placed_and_its_witnesses_stand_elsewhere() -> None:
    found = placed(np.vstack([CABINET, WALLS]), np.vstack([CABINET, WALLS]))
    assert found is not None and found.inliers == 46 and found.witnesses == 14
    assert found.pose == pytest.approx(THERE, abs=1e-3)


def test_witnesses_far_away_do_not_tell_the_position() -> None:
    """As a door seen through another: it agrees with whatever a board near the robot says."""
    far = np.random.default_rng(3).uniform((-0.5, -0.3, 9.0), (0.0, 0.3, 9.3), (14, 3))
    found = placed(np.vstack([CABINET, far]), np.vstack([CABINET, far]))
    near = placed(np.vstack([CABINET, WALLS]), np.vstack([CABINET, WALLS]))
    assert found is not None and near is not None
    assert found.witnesses == near.witnesses == 14
    assert near.unaided < CERTAIN < found.unaided


@pytest.mark.parametrize(('unaided', 'is_believed'), [(0.04, True), (0.06, False)])
def test_a_place_that_one_object_alone_tells_is_not_believed(
    unaided: float, is_believed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = ViewPose(THERE, 1e-6 * np.eye(3), 40, 20, unaided)
    monkeypatch.setattr(KeyViewTracker, 'match', lambda *_: Features())
    monkeypatch.setattr(KeyViewTracker, 'place', lambda *_: place)
    image = np.zeros((48, 64), np.uint8)
    found = _located(image, CurrentView(image), key_view(0), SMALL)
    assert (found is place) is is_believed


def test_a_cabinet_that_was_moved_is_outvoted_by_the_few_that_stand_elsewhere() -> None:
    assert placed(np.vstack([CABINET, WALLS]), np.vstack([CABINET + SHIFT, WALLS])) is None


def test_where_nothing_else_is_seen_a_cabinet_is_believed_without_a_witness() -> None:
    found = placed(CABINET, CABINET + SHIFT)
    assert found is not None and found.witnesses == 0
    assert found.pose == pytest.approx(THERE - [0.14, 0.0, 0.0], abs=1e-2)
