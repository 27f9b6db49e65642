"""
Pairs of photographs of public sets, with truth, for ``visual_servo bench real``.

    python docs/measurements/public_pairs.py CLONES OUT [SEED]

CLONES holds clones of the repositories of ``SETS``, by their names; OUT gets images, camera files
and truth.json. Pairs are drawn by SEED, 0 by default. Licences of the images are those of the
sets: some are for non-commercial use, so keep OUT to yourself.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
import json
import math
from pathlib import Path
import sys
from typing import Any, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from visual_servo_epipolar.core.geometry.rotation import headings

Array: TypeAlias = NDArray[np.float64]
Pose: TypeAlias = tuple[Array, Array]  # rotation, camera -> world, and centre [m]

GAPS = (1, 2, 3, 4)  # of images that follow each other
SHARE = 0.3  # of these pairs that are drawn
STRIDE = 40  # of the images of a video
CAMERA = """image_width: {width}
image_height: {height}
camera_name: {name}
camera_matrix: {{rows: 3, cols: 3, data: [{fx}, 0, {cx}, 0, {fy}, {cy}, 0, 0, 1]}}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: {distortion}}}
rectification_matrix: {{rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}
projection_matrix: {{rows: 3, cols: 4, data: [{fx}, 0, {cx}, 0, 0, {fy}, {cy}, 0, 0, 0, 1, 0]}}
"""


@dataclass(frozen=True)
class View:
    """A photograph and the pose of its camera."""

    image: Path
    pose: Pose


@dataclass(frozen=True)
class Sequence:
    """Photographs that follow each other: ``K`` (3, 3) [px], ``up`` (3,) in the world."""

    name: str
    views: list[View]
    K: Array
    up: Array
    distortion: tuple[float, ...] = (0.0,) * 5
    width: int = 0  # to which images are made smaller; 0 leaves them


def kitti(clone: Path) -> Iterator[Sequence]:
    """Yield road sequences; the camera is level."""
    for folder in sorted((clone / 'VisualOdometry').glob('KITTI_sequence_*')):
        K = _numbers((folder / 'calib.txt').read_text().splitlines()[0]).reshape(3, 4)[:, :3]
        poses = _numbers((folder / 'poses.txt').read_text()).reshape(-1, 3, 4)
        images = sorted((folder / 'image_l').glob('*.png'))
        views = [View(i, (p[:, :3], p[:, 3])) for i, p in zip(images, poses, strict=True)]
        yield Sequence(f'kitti{folder.name[-1]}', views, K, np.array([0.0, -1.0, 0.0]))


def strecha(clone: Path) -> Iterator[Sequence]:
    """Yield buildings from all around, by Strecha's laser scanner."""
    for folder in sorted((clone / 'Benchmarking_Camera_Calibration_2008').iterdir()):
        views = []
        for image in sorted((folder / 'images').glob('*.jpg')):
            camera = folder / 'gt_dense_cameras' / f'{image.name}.camera'
            values = _numbers(camera.read_text())
            views.append(View(image, (values[12:21].reshape(3, 3), values[21:24])))
        up = np.array([0.0, 0.0, -1.0])
        yield Sequence(folder.name, views, values[:9].reshape(3, 3), up, width=1024)


def fr3(clone: Path) -> Iterator[Sequence]:
    """Yield the hand-held office of TUM, by motion capture."""
    truth = _numbers(
        '\n'.join(
            line
            for line in (clone.parent / 'EAO-SLAM/data/groundtruth.txt').read_text().splitlines()
            if not line.startswith('#')
        )
    ).reshape(-1, 8)
    views = []
    for image in sorted((clone / 'assets/freiburg_sequence').glob('*.png')):
        stamp = float(image.stem)
        if stamp > truth[0, 0]:
            row = np.array([np.interp(stamp, truth[:, 0], each) for each in truth.T])
            views.append(View(image, (_rotation(row[4:]), row[1:4])))
    K = np.array([[535.4, 0.0, 320.1], [0.0, 539.2, 247.6], [0.0, 0.0, 1.0]])
    yield Sequence('tumfr3', views, K, np.array([0.0, 0.0, 1.0]))


def fox(clone: Path) -> Iterator[Sequence]:
    """Yield a phone's walk around a statue, by structure from motion."""
    folder = clone / 'data/nerf/fox'
    found = json.loads((folder / 'transforms.json').read_text())
    K = np.array([[found['fl_x'], 0, found['cx']], [0, found['fl_y'], found['cy']], [0, 0, 1.0]])
    views = []
    for frame in sorted(found['frames'], key=lambda each: str(each['file_path'])):
        pose = np.array(frame['transform_matrix'])
        if (folder / frame['file_path']).exists():
            axes = pose[:3, :3] @ np.diag([1.0, -1.0, -1.0])
            views.append(View(folder / frame['file_path'], (axes, pose[:3, 3])))
    distortion = (found['k1'], found['k2'], found['p1'], found['p2'], 0.0)
    yield Sequence('fox', views, K, np.array([0.0, 0.0, 1.0]), distortion, 720)


def seven_scenes(clone: Path) -> Iterator[Sequence]:
    """Yield an office by tracking of a depth camera: good to 2 deg, by a rough focal length."""
    views = []
    for image in sorted((clone / 'data').glob('*.color.jpg'))[::STRIDE]:
        pose = _numbers(image.with_name(image.name.replace('color.jpg', 'pose.txt')).read_text())
        pose = pose.reshape(4, 4)
        views.append(View(image, (pose[:3, :3], pose[:3, 3])))
    K = _numbers((clone / 'data/camera-intrinsics.txt').read_text()).reshape(3, 3)
    yield Sequence('7scenes', views, K, np.array([-0.009, -0.871, -0.491]))


SETS: dict[str, Callable[[Path], Iterator[Sequence]]] = {
    'niconielsen32/ComputerVision': kitti,
    'openMVG/SfM_quality_evaluation': strecha,
    'magicleap/SuperGluePretrainedNetwork': fr3,  # and yanmin-wu/EAO-SLAM for the truth
    'NVlabs/instant-ngp': fox,
    'andyzeng/tsdf-fusion-python': seven_scenes,
}


def _numbers(text: str) -> Array:
    return np.array(text.split(), float)


def _rotation(quaternion: Array) -> Array:
    """Return the rotation of (x, y, z, w), nearly of length 1."""
    x, y, z, w = quaternion / np.linalg.norm(quaternion)
    angle, axis = 2.0 * math.atan2(math.hypot(x, y, z), w), np.array([x, y, z])
    return np.asarray(cv2.Rodrigues(angle * axis / math.hypot(x, y, z))[0], float)


def truth_of(desired: Pose, current: Pose, up: Array) -> dict[str, Any]:
    """Return bearings and heading [deg]: in the ground plane, and in the cameras' axes."""
    rotation = desired[0].T @ current[0]
    centre = desired[0].T @ (current[1] - desired[1])
    goal = -rotation.T @ centre
    level = [_level(pose[0].T @ up) for pose in (desired, current)]
    flat = level[0] @ rotation @ level[1].T
    return {
        **_told(level[1] @ goal, level[0] @ centre, flat),
        'camera_frame': _told(goal, centre, rotation),
    }


def _level(up: Array) -> Array:
    """Return what turns axes of a camera, which sees ``up``, into level ones."""
    down = -up / np.linalg.norm(up)
    ahead = np.array([0.0, 0.0, 1.0]) - down[2] * down
    ahead /= np.linalg.norm(ahead)
    return np.stack([np.cross(down, ahead), down, ahead])


def _told(goal: Array, centre: Array, rotation: Array) -> dict[str, float]:
    return {
        'bearing_current_deg': math.degrees(math.atan2(goal[0], goal[2])),
        'bearing_desired_deg': math.degrees(math.atan2(centre[0], centre[2])),
        'rotation_deg': math.degrees(float(headings(rotation))),
    }


def pairs_of(sequence: Sequence, out: Path, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Write photographs and camera of a ``sequence``, and return its pairs."""
    pairs = []
    for first in range(len(sequence.views)):
        for second in (first + gap for gap in GAPS if first + gap < len(sequence.views)):
            if rng.random() >= SHARE:
                continue
            desired, current = rng.permutation([first, second]).tolist()
            poses = sequence.views[desired].pose, sequence.views[current].pose
            pairs.append(
                {
                    'name': f'{sequence.name}_d{desired:02d}_c{current:02d}',
                    'desired': _image(sequence, desired, out),
                    'current': _image(sequence, current, out),
                    'camera': f'{sequence.name}.yaml',
                    'truth': truth_of(*poses, sequence.up),
                }
            )
    _camera(sequence, out)
    return pairs


def _image(sequence: Sequence, k: int, out: Path) -> str:
    name = f'{sequence.name}_{k:02d}.png'
    cv2.imwrite(str(out / name), _read(sequence, k))
    return name


def _read(sequence: Sequence, k: int) -> Any:
    image = cv2.imread(str(sequence.views[k].image), cv2.IMREAD_GRAYSCALE)
    if not sequence.width:
        return image
    height = round(image.shape[0] * sequence.width / image.shape[1])
    return cv2.resize(image, (sequence.width, height), interpolation=cv2.INTER_AREA)


def _camera(sequence: Sequence, out: Path) -> None:
    height, width = _read(sequence, 0).shape
    full = cv2.imread(str(sequence.views[0].image), cv2.IMREAD_GRAYSCALE).shape[1]
    K, scale = sequence.K, width / full
    text = CAMERA.format(
        width=width,
        height=height,
        name=sequence.name,
        fx=scale * K[0, 0],
        fy=scale * K[1, 1],
        cx=scale * (K[0, 2] + 0.5) - 0.5,
        cy=scale * (K[1, 2] + 0.5) - 0.5,
        distortion=list(map(float, sequence.distortion)),
    )
    (out / f'{sequence.name}.yaml').write_text(text)


def main(clones: Path, out: Path, seed: str = '0') -> None:
    """Write the pairs of all sets."""
    out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(int(seed))
    pairs = [
        pair
        for repository, sequences in SETS.items()
        for sequence in sequences(clones / repository.split('/')[1])
        for pair in pairs_of(sequence, out, rng)
    ]
    (out / 'truth.json').write_text(json.dumps(pairs, indent=1))
    print(f'{len(pairs)} pairs in {out}; next: visual_servo bench real {out}')


if __name__ == '__main__':
    main(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:])
