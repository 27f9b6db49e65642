"""Photographs with truth: what ``inspect`` trusts, OpenCV's MAGSAC and RANSAC beside it."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise
import json
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from visual_servo_epipolar.commands.camera_files import read_camera, read_photograph, scaled_to
from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.rays import image_points, LEAST_FORWARD
from visual_servo_epipolar.core.twoview.general_motion import Motions
from visual_servo_epipolar.core.twoview.inspection import inspect
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings
from visual_servo_epipolar.evaluation.tables import aligned, percentiles

PEERS = {'MAGSAC': cv2.USAC_MAGSAC, 'RANSAC': cv2.RANSAC}
PEER_PX = 1.5
WRONG = 3.0  # error [deg]
BANDS = {
    'deviation_deg': (0.0, 0.4, 0.7, 1.0, 1.5),
    'matches': (0, 70, 120, 250),
}  # begins of them
COLUMNS = (
    'set | n | trusted | median / p90 / max [deg] | wrong | error/dev., median / p95 '
    '| MAGSAC, RANSAC wrong | of MAGSAC right'
)
KEYS = ('bearing_current_deg', 'bearing_desired_deg', 'rotation_deg')  # of truth.json

Rays = tuple[FloatArray, FloatArray]


@dataclass(frozen=True, slots=True, eq=False)
class TruePair:
    """
    Two photographs, desired and current, with their ``cameras``, and the truth.

    ``ground`` and ``own``, shape (3,), are bearings, current and desired, and heading [rad]: in
    the ground plane, and in axes of the cameras. ``group`` names the set they are of.
    """

    name: str
    group: str
    images: tuple[Image, Image]
    cameras: tuple[CameraModel, CameraModel]
    ground: FloatArray
    own: FloatArray


def run(
    *, seed: int, quick: bool, say: Callable[[str], None], photographs: Iterable[TruePair]
) -> dict[str, Any]:
    """Return the document: a row for each pair of ``photographs``; ``quick``: of the first two."""
    pairs = [_row(pair, say) for pair in islice(photographs, 2 if quick else None)]
    return {'seed': seed, 'pairs': pairs}


def _row(pair: TruePair, say: Callable[[str], None]) -> dict[str, Any]:
    """Return the errors [deg] of a pair, ours in the frame that is named."""
    say(pair.name)
    desired, current = pair.cameras
    found = inspect(*pair.images, desired, current, PerceptionSettings())
    rays = current.rays(found.current), desired.rays(found.desired)
    answers = np.array([found.bearing_current, found.bearing_desired, found.rotation])
    away = angle_errors(answers, pair.ground if found.ground else pair.own)
    peers = {it: opencv_motion(rays, PEER_PX / desired.focal, PEERS[it]) for it in PEERS}
    return {
        'name': pair.name,
        'group': pair.group,
        'trusted': found.trusted,
        'reason': found.reason,
        'planar': found.planar,
        'matches': len(rays[0]),
        'error_deg': away[:2].max(),
        'rotation_error_deg': away[2],
        'deviation_deg': math.degrees(found.deviation),
        'peers_deg': {
            it: float(angle_errors(motion, pair.own)[:2].max()) for it, motion in peers.items()
        },
    }


def angle_errors(found: FloatArray, true: FloatArray) -> FloatArray:
    """Return the sizes of differences of angles [deg]."""
    return np.degrees(np.abs(np.remainder(found - true + np.pi, 2.0 * np.pi) - np.pi))


def opencv_motion(rays: Rays, noise: float, method: int) -> FloatArray:
    """Return bearings and heading by OpenCV's essential matrix, (3,); nan of none; noise [rad]."""
    front = np.minimum(rays[0][:, 2], rays[1][:, 2]) > LEAST_FORWARD
    points = image_points(rays[0][front]), image_points(rays[1][front])
    cv2.setRNGSeed(0)
    try:
        essential, mask = cv2.findEssentialMat(*points, np.eye(3), method, 0.999, noise)
    except cv2.error:  # of too few matches
        return np.full(3, math.nan)
    if essential is None or essential.shape != (3, 3):
        return np.full(3, math.nan)
    _, rotation, centre, _ = cv2.recoverPose(essential, *points, np.eye(3), mask=mask)
    return np.asarray(Motions(rotation[None], centre.ravel()[None]).bearings[0])


def table(document: Mapping[str, Any]) -> str:
    """Return the document as text: a line for each set of pairs, for all, and for each band."""
    return '\n'.join(['Photographs', *set_lines(document['pairs'])])


def set_lines(pairs: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a line for each ``group`` of ``pairs``, for all, and for each band that has some."""
    groups = dict.fromkeys(it['group'] for it in pairs)
    sets = {name: [it for it in pairs if it['group'] == name] for name in groups}
    sets |= {'all': [*pairs]} if len(groups) > 1 else {}
    for key, begins in BANDS.items():
        for low, high in pairwise([*begins, math.inf]):
            sets[f'{key} {low:g} to {high:g}'] = [it for it in pairs if low <= it[key] < high]
    words = (
        f'The larger error of both bearings, of trusted pairs; wrong: > {WRONG:g} deg; peers '
        'on the same matches, of all pairs; of those that MAGSAC has right, how many are trusted'
    )
    return [words, *aligned(COLUMNS, (_set(*it) for it in sets.items() if it[1]))]


def _set(name: str, pairs: Sequence[Mapping[str, Any]]) -> list[str]:
    trusted = [it for it in pairs if it['trusted']]
    errors = np.array([it['error_deg'] for it in trusted])
    normalised = np.array([it['error_deg'] / it['deviation_deg'] for it in trusted])
    right = [it for it in pairs if it['peers_deg']['MAGSAC'] <= WRONG]
    peers = (
        sum(not it['peers_deg'][each] <= WRONG for it in pairs) for each in pairs[0]['peers_deg']
    )
    return [
        name,
        str(len(pairs)),
        str(len(trusted)),
        percentiles(errors, 50, 90, 100),
        str(int((errors > WRONG).sum())),
        percentiles(normalised, 50, 95),
        ', '.join(map(str, peers)),
        f'{sum(it["trusted"] for it in right)} of {len(right)}',
    ]


def read_pairs(folder: str) -> Iterator[TruePair]:
    """Return the pairs of a ``folder``, one after the other; InputError if it has none."""
    path, pairs = read_truth(folder, list, 'be a list of pairs')
    return (_read(pair, path) for pair in pairs)


def read_truth(folder: str, kind: type, words: str) -> tuple[Path, Any]:
    """Return the truth.json of a ``folder``, and what is in it; it must be of a ``kind``."""
    path = Path(folder) / 'truth.json'
    try:
        truth = json.loads(path.read_text())
    except OSError as error:
        raise InputError(
            f'{path} cannot be read: {error.strerror}; give the folder of that file'
        ) from None
    except ValueError:
        raise InputError(f'{path} must be JSON; see docs/commands/bench.md') from None
    if not isinstance(truth, kind) or not truth:
        raise InputError(f'{path} must {words}; see docs/commands/bench.md')
    return path, truth


def _read(pair: Any, path: Path) -> TruePair:
    try:
        name, files = str(pair['name']), [pair[key] for key in ('desired', 'current', 'camera')]
        truth = pair['truth']
        ground = [float(truth[key]) for key in KEYS]
        own = [float(truth.get('camera_frame', truth)[key]) for key in KEYS]
    except (AttributeError, KeyError, TypeError, ValueError):
        raise InputError(
            f'{path}: a pair must have name, desired, current, camera and truth, got '
            f'{str(pair)[:60]}; see docs/commands/bench.md'
        ) from None
    first, second, camera_file = (path.parent / str(file) for file in files)
    desired, current = (read_photograph(path) for path in (first, second))
    camera = read_camera(str(camera_file))
    cameras = scaled_to(camera, desired, first), scaled_to(camera, current, second)
    group = camera_file.stem
    return TruePair(name, group, (desired, current), cameras, np.radians(ground), np.radians(own))
