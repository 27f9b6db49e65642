"""
Folder of a route: route.yaml, camera.yaml, structure.npz, and photographs 000000.png, ...

Photographs of stations are PNG, to the last bit; others are JPEG, at a fraction of the size. Those
of other days are beside the first one of their key view: 000000_1.png, ...

It is written beside its place and renamed, so that it is there whole or not at all; photographs
are read when they are needed.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
import hashlib
import json
from pathlib import Path
import shutil
from tempfile import mkdtemp
from typing import Any
from zipfile import BadZipFile

import cv2
import numpy as np
import yaml

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.routes.path import TaughtPath
from visual_servo_epipolar.core.routes.route import Appearance, Route, RouteView
from visual_servo_epipolar.core.routes.structure import LocalStructure
from visual_servo_epipolar.core.tracking.matchers.base import Keypoints
from visual_servo_epipolar.messages import camera_file
from visual_servo_epipolar.messages.images import pictures

VERSION = 1
ROUTE, CAMERA, STRUCTURE = 'route.yaml', 'camera.yaml', 'structure.npz'
ENCODING = {'.png': [cv2.IMWRITE_PNG_COMPRESSION, 6], '.jpg': [cv2.IMWRITE_JPEG_QUALITY, 90]}
RENEWED = ('rows', 'pixels', 'sizes', 'angles', 'descriptors')
AGAIN = 'copy the folder anew from where it is whole, or teach the route again'
Loader = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


def write_route(route: Route, folder: Path) -> None:
    """
    Write a ``route`` as ``folder``, in place of a route that is there.

    Raises InputError if it cannot be written, and leaves what was there as it was.
    """
    _refuse_other(folder)
    partial_folder = None
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        partial_folder = Path(mkdtemp(dir=folder.parent, prefix=f'.{folder.name}.partial_'))
        _write_files(route, partial_folder)
        _replace(folder, partial_folder)
    except OSError as error:
        raise InputError(
            f'{folder}: the route cannot be written: {error.strerror or error}; make room or name '
            'another folder, nothing of an earlier route there is lost'
        ) from None
    finally:
        if partial_folder is not None:
            shutil.rmtree(partial_folder, ignore_errors=True)


def _refuse_other(folder: Path) -> None:
    is_free = not folder.exists() or folder.is_dir() and not any(folder.iterdir())
    if not is_free and not (folder / ROUTE).is_file():
        raise InputError(
            f'{folder} must be a new folder or one of a route, but holds something else; name '
            'another one'
        )


def _replace(folder: Path, new: Path) -> None:
    """Put the ``new`` folder in place of the old one, which goes last."""
    new.chmod(0o755)
    if not folder.exists():
        new.rename(folder)
        return
    old = Path(mkdtemp(dir=folder.parent, prefix=f'.{folder.name}.old_'))
    folder.rename(old / 'route')
    try:
        new.rename(folder)
    except OSError:
        (old / 'route').rename(folder)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _write_files(route: Route, folder: Path) -> None:
    for number, view in enumerate(route.views):
        for name, appearance in zip(_photographs(number, view), view.appearances, strict=True):
            _write_photograph(appearance.load, folder / name)
    with open(folder / STRUCTURE, 'wb') as file:
        np.savez_compressed(file, **_arrays(route.views))
    document = camera_file.to_document(route.camera)
    document['sha256'] = calibration_hash(route.camera)
    (folder / CAMERA).write_text(yaml.safe_dump(document), encoding='utf-8')
    views = [
        {
            'photograph': _photographs(number, view)[0],
            'way': round(view.way, 6),
            'pose': [round(value, 9) for value in view.pose.tolist()],
            'station': view.is_station,
            **({'renewed': _photographs(number, view)[1:]} if view.renewed else {}),
        }
        for number, view in enumerate(route.views)
    ]
    head = f'version: {VERSION}\nlength: {route.length:.6f}  # [m]\ncamera: {CAMERA}\nviews:\n'
    # Lists of one line each, which are JSON as well as YAML.
    lines = [f'- {json.dumps(view)}\n' for view in views]
    (folder / ROUTE).write_text(head + ''.join(lines), encoding='utf-8')


def calibration_hash(camera: CameraModel) -> str:
    """Return the hash of what a calibration says, in hexadecimal digits."""
    text = json.dumps(camera_file.to_document(camera), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def route_hash(folder: Path) -> str:
    """Return the hash of a route in its folder, by which a bag knows it, in hexadecimal digits."""
    return hashlib.sha256((folder / ROUTE).read_bytes()).hexdigest()


def _photographs(number: int, view: RouteView) -> list[str]:
    """Return the names of the photographs of a key view, its first one first."""
    kind, count = 'png' if view.is_station else 'jpg', len(view.renewed)
    return [f'{number:06d}{"" if k == 0 else f"_{k}"}.{kind}' for k in range(1 + count)]


def _write_photograph(load: Callable[[], Image], path: Path) -> None:
    """Write a photograph; one that lies on the disk already is copied, and loses nothing."""
    if isinstance(load, StoredPhotograph) and load.path.suffix == path.suffix:
        shutil.copyfile(load.path, path)
        return
    _, encoded = cv2.imencode(path.suffix, load(), ENCODING[path.suffix])
    path.write_bytes(encoded.tobytes())


def _columns(view: RouteView) -> dict[str, Any]:
    """Return the arrays of a key view, rows are features, or samples of the path."""
    keypoints, structure, path = view.keypoints, view.structure, view.path
    return _keypoint_columns(keypoints) | {
        'offsets': structure.offsets.T,
        'inverse_depth': structure.inverse_depth,
        'covariance': structure.covariance.transpose(2, 0, 1),
        'path': np.column_stack([path.way, path.poses, path.curvatures, path.speeds]),
        'shared': np.append(structure.shared, structure.jitter)[None],
        'tuning': np.array([[int(keypoints.tuning or 1)]]),  # type: ignore[call-overload]
    }


def _arrays(views: Sequence[RouteView]) -> dict[str, Any]:
    each = [_columns(view) for view in views]
    arrays = {name: np.concatenate([columns[name] for columns in each]) for name in each[0]}
    counts = {f'{name}_count': [len(it[name]) for it in each] for name in ('pixels', 'path')}
    arrays |= {name: np.array(count) for name, count in counts.items()}
    renewed = [
        {'rows': it.rows} | _keypoint_columns(it.keypoints)
        for view in views
        for it in view.renewed
    ]
    if renewed:
        arrays['renewed_count'] = np.array([len(columns['rows']) for columns in renewed])
        for name in RENEWED:
            arrays[f'renewed_{name}'] = np.concatenate([columns[name] for columns in renewed])
    return arrays


def _keypoint_columns(keypoints: Keypoints) -> dict[str, Any]:
    return {
        'pixels': keypoints.pixels,
        'sizes': keypoints.sizes,
        'angles': keypoints.angles,
        'descriptors': keypoints.descriptors.astype(np.uint16),
    }


def read_route(folder: Path) -> Route:
    """Return the route in a ``folder``; raises InputError with what is wrong with it."""
    with suppress(OSError):
        if not (folder / ROUTE).exists():
            raise InputError(
                f'{folder} is no folder of a route, for it has no {ROUTE}; name one that '
                'visual_servo route teach, route demo or route_node wrote'
            )
    document = _document(folder / ROUTE)
    try:
        version, rows = document['version'], list(document['views'])
        names = [str(row['photograph']) for row in rows]
        poses = np.array([row['pose'] for row in rows], np.float64).reshape(len(rows), 3)
        ways, stations = [float(it['way']) for it in rows], [bool(it['station']) for it in rows]
        renewed = [[str(name) for name in row.get('renewed', ())] for row in rows]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f'{folder / ROUTE} is cut off or damaged: {error!r}; {AGAIN}') from None
    if version != VERSION:
        raise InputError(
            f'{folder / ROUTE} is of version {version}, {VERSION} can be read; teach it anew'
        )
    camera = _camera(folder / CAMERA)
    every = [*names, *(name for each in renewed for name in each)]
    _refuse_missing(folder, every)
    parts = _parts(folder / STRUCTURE, [len(each) for each in renewed])
    loads = {
        name: StoredPhotograph(folder / name, (camera.height, camera.width)) for name in every
    }
    try:
        views = [
            _key_view([loads[name] for name in (first, *others)], *row)
            for first, others, *row in zip(
                names, renewed, parts, ways, poses, stations, strict=True
            )
        ]
        return Route(camera, tuple(views))
    except (KeyError, IndexError, ValueError) as error:
        raise InputError(f'{folder}: the route is damaged: {error}; {AGAIN}') from None


def _refuse_missing(folder: Path, names: Sequence[str]) -> None:
    missing = [name for name in names if not (folder / name).is_file()]
    if missing:
        raise InputError(
            f'{folder}: {len(missing)} of {len(names)} photographs are missing, the first is '
            f'{missing[0]}; {AGAIN}'
        )


def _document(path: Path) -> Mapping[str, Any]:
    try:
        document = yaml.load(path.read_text(encoding='utf-8'), Loader)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(
            f'{path} cannot be read: {" ".join(str(error).split())}; {AGAIN}'
        ) from None
    if not isinstance(document, Mapping):
        raise InputError(f'{path} is cut off or damaged: it holds no names; {AGAIN}')
    return document


def _camera(path: Path) -> CameraModel:
    document = dict(_document(path))
    expected = document.pop('sha256', None)
    try:
        camera = camera_file.from_document(document)
    except ValueError as error:
        raise InputError(f'{path} cannot be used: {error}; {AGAIN}') from None
    if calibration_hash(camera) != expected:
        raise InputError(
            f'{path} is not the calibration that the route was taught with: its hash differs; '
            f'put it back as it was, or teach the route anew'
        )
    return camera


def _parts(path: Path, renewed: Sequence[int]) -> list[dict[str, Any]]:
    """Return the arrays of each key view, which was ``renewed`` so many times."""
    count = len(renewed)
    try:
        with open(path, 'rb') as opened, np.load(opened, allow_pickle=False) as file:
            arrays = dict(file)
        looks = _renewed_parts(arrays, sum(renewed))
        features, samples = (np.cumsum(arrays.pop(f'{it}_count')) for it in ('pixels', 'path'))
        ends = {name: features for name in arrays} | {'path': samples}
        ends |= dict.fromkeys(('shared', 'tuning'), np.arange(1, count + 1))
        split = {name: np.split(array, ends[name][:-1]) for name, array in arrays.items()}
        parts = [{name: parts[k] for name, parts in split.items()} for k in range(count)]
        return [
            part | {'renewed': [next(looks) for _ in range(times)]}
            for part, times in zip(parts, renewed, strict=True)
        ]
    except (OSError, BadZipFile, KeyError, IndexError, ValueError, EOFError) as error:
        raise InputError(f'{path} is missing, cut off or damaged: {error}; {AGAIN}') from None


def _renewed_parts(arrays: dict[str, Any], count: int) -> Iterator[dict[str, Any]]:
    """Take the arrays of photographs of other days out of ``arrays``; yield those of each."""
    if not count:
        return iter(())
    ends = np.cumsum(arrays.pop('renewed_count'))
    if len(ends) != count:
        raise ValueError(f'{len(ends)} photographs of other days, {count} are named')
    split = {name: np.split(arrays.pop(f'renewed_{name}'), ends[:-1]) for name in RENEWED}
    return iter([{name: parts[k] for name, parts in split.items()} for k in range(count)])


@dataclass(frozen=True, slots=True)
class StoredPhotograph:
    """A photograph of ``shape`` (H, W) on the disk, read when it is called."""

    path: Path
    shape: tuple[int, int]

    def __call__(self) -> Image:
        """Return the image; InputError with what is wrong with it."""
        path, (height, width) = self.path, self.shape
        try:
            image = pictures.decode(path.read_bytes(), str(path))
        except (OSError, ValueError) as error:
            raise InputError(f'{path}: the photograph cannot be read: {error}; {AGAIN}') from None
        if image.shape != self.shape or image.dtype != np.uint8:
            raise InputError(
                f'{path} must have {width}x{height} grey pixels of 8 bits as the camera of the '
                f'route, got {image.shape[1]}x{image.shape[0]} of {image.dtype}; {AGAIN}'
            )
        return np.asarray(image, np.uint8)


def _key_view(
    loads: Sequence[StoredPhotograph],
    part: Mapping[str, Any],
    way: float,
    pose: Any,
    is_station: bool,
) -> RouteView:
    shared, path = part['shared'][0], part['path']
    tuning = int(part['tuning'][0, 0])
    keypoints = _keypoints(part, tuning)
    structure = LocalStructure(
        keypoints.pixels,
        part['offsets'].T,
        part['inverse_depth'],
        part['covariance'].transpose(1, 2, 0),
        shared[:-1],
        float(shared[-1]),
    )
    if not all(np.isfinite(getattr(structure, item.name)).all() for item in fields(structure)):
        raise ValueError('a structure must be finite')
    taught = TaughtPath(path[:, 0], path[:, 1:4], path[:, 4], path[:, 5])
    renewed = tuple(
        Appearance(load, _keypoints(look, tuning), look['rows'])
        for load, look in zip(loads[1:], part['renewed'], strict=True)
    )
    if any(look.rows.max(initial=0) >= len(keypoints) for look in renewed):
        raise ValueError('a photograph of another day has features that the key view has not')
    return RouteView(loads[0], keypoints, structure, taught, way, pose, is_station, renewed)


def _keypoints(part: Mapping[str, Any], tuning: int) -> Keypoints:
    descriptors = part['descriptors'].astype(np.float32)
    return Keypoints(part['pixels'], part['sizes'], part['angles'], descriptors, tuning)
