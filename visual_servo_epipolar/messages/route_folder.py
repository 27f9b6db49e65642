"""
Folder of a route: route.yaml, camera.yaml, structure.npz, and photographs 000000.webp, ...

Photographs are WebP, those of stations to the last bit, others at a fraction of the size. Those of
other days are beside the first one of their key view: 000000_1.webp, ... Earlier folders hold PNG
and JPEG, which stay as they are.

It is written all at once, and route.yaml has the hashes of all parts: files of two routes are
none. Other files in the folder are the user's, and stay. Images are read when they are needed.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
import errno
import hashlib
import io
from itertools import islice
import json
from lzma import LZMAError
import os
from pathlib import Path
import re
from typing import Any, NamedTuple
from zipfile import BadZipFile
import zlib

import cv2
import numpy as np
from numpy.typing import NDArray
import yaml

from visual_servo_epipolar.core.arrays import FloatArray, Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.mapping.window import SHARED
from visual_servo_epipolar.core.routes.path import TaughtPath
from visual_servo_epipolar.core.routes.route import Appearance, Bridge, Route, RouteView
from visual_servo_epipolar.core.routes.structure import LocalStructure
from visual_servo_epipolar.core.tracking.matchers.base import Keypoints
from visual_servo_epipolar.files import (
    all_at_once,
    COMPLETE,
    FORMER,
    PARTIAL,
    place_of,
    try_out,
    yaml_document,
)
from visual_servo_epipolar.messages import camera_file, encodings

VERSION = 1
FORMER_NOISE_PX = 0.1  # of a structure that does not name its own
ROUTE, CAMERA, STRUCTURE = 'route.yaml', 'camera.yaml', 'structure.npz'
PHOTOGRAPH = re.compile(r'\d{6}(_\d+)?\.(webp|png|jpg)')
QUALITY, LOSSLESS = 75, 101  # of WebP
# What is kept of pixels, of descriptors, of norm 512, and of paths [m, rad]; and of other numbers
# the binary digits: the noise of each is larger.
PIXEL_STEP, DESCRIPTOR_STEP, PATH_STEP = 2.0**-4, 16, 2.0**-16
DEPTH_BITS, BITS = 12, 8
KEYPOINTS = ('pixels', 'sizes', 'angles', 'descriptors')  # a row a feature, as the next ones
STRUCTURES = ('offsets', 'inverse_depth', 'covariance')
AGAIN = 'copy the folder anew from where it is whole, or teach the route again'
# What reading a damaged zip raises; RuntimeError where its bytes ask for a password or a method,
# LZMAError of folders that are packed by that.
DAMAGES = (
    OSError,
    EOFError,
    BadZipFile,
    LZMAError,
    zlib.error,
    LookupError,
    ValueError,
    RuntimeError,
)
Loader = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)


def is_route(folder: Path) -> bool:
    """Return whether a route is in a ``folder``, damaged or not."""
    return place_of(folder, ROUTE).is_file()


def check_folder(folder: Path) -> None:
    """
    Raise InputError if no route can be written as ``folder``; leaves no trace.

    It must be new or empty, but for leftovers of a kill, or hold a route, which is replaced.
    """
    place = Path(os.path.realpath(folder))
    try:
        names = [item.name for item in place.iterdir()] if place.exists() else []
        others = sorted(name for name in names if not name.startswith((PARTIAL, COMPLETE)))
        if others and not is_route(place):
            raise InputError(
                f'{folder} must be a new folder or one of a route, but holds something else, '
                f'{others[0]}; name another one'
            )
        try_out(place)
    except OSError as error:
        raise _unwritable(folder, error) from None


def write_route(route: Route, folder: Path) -> None:
    """
    Write a ``route`` as ``folder``, in place of a route that is there; other files stay.

    Raises InputError if it cannot be written, and leaves what was there as it was.
    """
    check_folder(folder)
    try:
        with all_at_once(folder) as new:
            before = _own_files(folder)
            parts = _write_files(route, new, folder)
            foreign = [it for it in parts - before if os.path.lexists(folder / it)]
            if foreign:
                raise InputError(
                    f'{folder / min(foreign)} is no part of the route there, which would replace '
                    'it; move it elsewhere, or name another folder'
                )
            (new / FORMER).write_text('\n'.join(before - parts), encoding='utf-8')
    except OSError as error:
        raise _unwritable(folder, error) from None


def _unwritable(folder: Path, error: OSError) -> InputError:
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    remedy = 'make room' if full else 'name another folder'
    return InputError(
        f'{folder}: the route cannot be written: {error.strerror or error}; {remedy}, an earlier '
        'route there is as it was'
    )


def _own_files(folder: Path) -> set[str]:
    """Return the names of the files of the route in ``folder``, none where there is none."""
    if not is_route(folder):
        return set()
    try:
        names = [name for row in _head(folder)[0] for name in row.names]
    except InputError:  # damaged: its photographs are known by their names alone
        names = [item.name for item in folder.iterdir()]
    return {ROUTE, CAMERA, STRUCTURE, *filter(PHOTOGRAPH.fullmatch, names)}


def folder_bytes(folder: Path) -> int:
    """Return the size of the files of the route in ``folder``."""
    return sum(place_of(folder, name).stat().st_size for name in _own_files(folder))


def _write_files(route: Route, new: Path, folder: Path) -> set[str]:
    """Write into ``new`` what is not in ``folder`` as it is; return the names of all files."""
    hashes: dict[str, str] = {}
    lines = []
    for number, view in enumerate(route.views):
        names = []
        for k, load in enumerate(each.load for each in view.appearances):
            stored = load if isinstance(load, StoredPhotograph) else None
            kind = '.webp' if stored is None else Path(stored.name).suffix
            names.append(name := f'{number:06d}{f"_{k}" if k else ""}{kind}')
            if stored is None:
                quality = [cv2.IMWRITE_WEBP_QUALITY, LOSSLESS if view.is_station else QUALITY]
                content = cv2.imencode('.webp', load(), quality)[1].tobytes()
            else:
                content = stored.read()  # as it is: to decode and encode it would lose something
            hashes[name] = _hash(content)
            if stored is None or (stored.folder, stored.name) != (folder, name):
                (new / name).write_bytes(content)
        row = {
            'photograph': names[0],
            'way': round(view.way, 6),
            'pose': [round(value, 9) for value in view.pose.tolist()],
            'station': view.is_station,
            **({'renewed': names[1:]} if view.renewed else {}),
            **({'bridge': asdict(view.bridge)} if view.bridge is not None else {}),
        }
        lines.append(f'- {json.dumps(row)}\n')  # a line each, which is JSON as well as YAML
    np.savez_compressed(new / STRUCTURE, **_arrays(route.views))
    camera = camera_file.to_document(route.camera)
    camera['sha256'] = calibration_hash(route.camera)
    (new / CAMERA).write_text(yaml.safe_dump(camera), encoding='utf-8')
    hashes |= {STRUCTURE: _hash((new / STRUCTURE).read_bytes()), CAMERA: camera['sha256']}
    head = f'version: {VERSION}\nlength: {route.length:.6f}  # [m]\ncamera: {CAMERA}\nsha256:\n'
    parts = [f'  {json.dumps(name)}: {json.dumps(hashes[name])}\n' for name in sorted(hashes)]
    text = ''.join([head, *parts, 'views:\n', *lines])
    (new / ROUTE).write_text(text, encoding='utf-8')
    return {ROUTE, *hashes}


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def calibration_hash(camera: CameraModel) -> str:
    """Return the hash of what a calibration says, in hexadecimal digits."""
    text = json.dumps(camera_file.to_document(camera), sort_keys=True)
    return _hash(text.encode())


def _arrays(views: Sequence[RouteView]) -> dict[str, Any]:
    """Return the arrays of all key views: rows are features, or samples of the path."""
    each = [_columns(view) for view in views]
    arrays = _joined(each)
    for name in ('pixels', 'path'):
        arrays[f'{name}_count'] = np.array([len(columns[name]) for columns in each])
    looks = [
        {'rows': it.rows} | _keypoint_columns(it.keypoints)
        for view in views
        for it in view.renewed
    ]
    if looks:
        arrays['renewed_count'] = np.array([len(columns['rows']) for columns in looks])
        arrays |= {f'renewed_{name}': column for name, column in _joined(looks).items()}
    return arrays


def _joined(each: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {name: np.concatenate([columns[name] for columns in each]) for name in each[0]}


def _columns(view: RouteView) -> dict[str, Any]:
    keypoints, structure, path = view.keypoints, view.structure, view.path
    return _keypoint_columns(keypoints) | {
        'offsets': _digits(structure.offsets.T, BITS),
        'inverse_depth': _digits(structure.inverse_depth, DEPTH_BITS),
        'covariance': _digits(structure.covariance.transpose(2, 0, 1), BITS),
        'path': _steps(np.column_stack([path.way, path.poses, path.curvatures, path.speeds])),
        'shared': np.concatenate([structure.shared, [structure.jitter, structure.noise]])[None],
        'tuning': np.array([[int(keypoints.tuning or 1)]]),  # type: ignore[call-overload]
    }


def _keypoint_columns(keypoints: Keypoints) -> dict[str, Any]:
    whole = _steps(keypoints.descriptors, DESCRIPTOR_STEP)
    return {
        'pixels': _steps(keypoints.pixels, PIXEL_STEP),
        'sizes': _digits(keypoints.sizes, BITS),
        'angles': _digits(keypoints.angles, BITS),
        'descriptors': whole.astype(np.uint8 if whole.max(initial=0) < 256 else np.uint16),
    }


def _steps(values: NDArray[Any], step: float = PATH_STEP) -> NDArray[Any]:
    """Return the nearest multiples of a ``step``, which are compressed well."""
    return step * np.rint(values / step)


def _digits(values: FloatArray, bits: int) -> NDArray[np.float32]:
    """Return ``values`` to so many binary digits, which are compressed well."""
    mantissa, exponent = np.frexp(values)
    return np.asarray(np.ldexp(np.rint(np.ldexp(mantissa, bits)), exponent - bits), np.float32)


class _Row(NamedTuple):
    """Row of a key view in route.yaml; ``names`` are those of its photographs."""

    names: list[str]
    way: float
    pose: FloatArray
    is_station: bool
    bridge: Bridge | None


def _head(folder: Path) -> tuple[list[_Row], Mapping[str, str]]:
    """Return what route.yaml says of key views, and hashes of all parts: none of early folders."""
    path = folder / ROUTE
    document = _document(place_of(folder, ROUTE))
    if document.get('version') != VERSION:
        raise InputError(
            f'{path} is of version {document.get("version")}, {VERSION} can be read; teach it anew'
        )
    try:
        rows = [
            _Row(
                [str(name) for name in (row['photograph'], *row.get('renewed', ()))],
                float(row['way']),
                np.array(row['pose'], np.float64),
                bool(row['station']),
                Bridge(**row['bridge']) if 'bridge' in row else None,
            )
            for row in document['views']
        ]
        hashes = dict(document.get('sha256', {}))
        photographs = {name for row in rows for name in row.names}
        if hashes and hashes.keys() != {STRUCTURE, CAMERA, *photographs}:
            raise ValueError('its hashes are not those of its parts')
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise InputError(f'{path} is cut off or damaged: {error!r}; {AGAIN}') from None
    return rows, hashes


def read_route(folder: Path) -> Route:
    """Return the route in a ``folder``; raises InputError with what is wrong with it."""
    with suppress(OSError):
        if not place_of(folder, ROUTE).exists():
            raise InputError(
                f'{folder} is no folder of a route, for it has no {ROUTE}; name one that '
                'visual_servo route teach, route demo or route_node wrote'
            )
    rows, hashes = _head(folder)
    camera = _camera(place_of(folder, CAMERA), hashes.get(CAMERA))
    names = [name for row in rows for name in row.names]
    missing = [name for name in names if not place_of(folder, name).is_file()]
    if missing:
        raise InputError(
            f'{folder}: {len(missing)} of {len(names)} photographs are missing, the first is '
            f'{missing[0]}; {AGAIN}'
        )
    others = [len(row.names) - 1 for row in rows]
    parts = _parts(place_of(folder, STRUCTURE), hashes.get(STRUCTURE), others)
    shape = camera.height, camera.width
    loads = [
        [StoredPhotograph(folder, name, shape, hashes.get(name)) for name in row.names]
        for row in rows
    ]
    try:
        return Route(camera, tuple(map(_key_view, rows, loads, parts)))
    except (KeyError, IndexError, ValueError) as error:
        raise InputError(f'{folder}: the route is damaged: {error}; {AGAIN}') from None


def _document(path: Path) -> Mapping[str, Any]:
    try:
        document = yaml_document(path.read_text(encoding='utf-8'), Loader)
    except (OSError, ValueError) as error:
        raise InputError(f'{path} cannot be read: {error}; {AGAIN}') from None
    if not isinstance(document, Mapping):
        raise InputError(f'{path} is cut off or damaged: it holds no names; {AGAIN}')
    return document


def _camera(path: Path, expected: str | None) -> CameraModel:
    document = dict(_document(path))
    written = document.pop('sha256', None)
    try:
        camera = camera_file.from_document(document)
    except ValueError as error:
        raise InputError(f'{path} cannot be used: {error}; {AGAIN}') from None
    if calibration_hash(camera) != (expected or written):
        raise InputError(
            f'{path} is not the calibration that the route was taught with: its hash differs; '
            f'put it back as it was, or teach the route anew'
        )
    return camera


def _parts(path: Path, sha256: str | None, others: Sequence[int]) -> list[dict[str, Any]]:
    """Return the columns of each key view, which has so many photographs of ``others`` days."""
    try:
        with np.load(io.BytesIO(_read(path, sha256)), allow_pickle=False) as file:
            arrays = dict(file)
        columns = zip(
            others,
            _split(arrays, (*KEYPOINTS, *STRUCTURES), arrays['pixels_count']),
            _split(arrays, ('path',), arrays['path_count']),
            arrays['shared'],
            arrays['tuning'],
            strict=True,
        )
        names, counts = ('rows', *KEYPOINTS), arrays.get('renewed_count', np.zeros(1, int))
        looks = iter(_split(arrays, names, counts, 'renewed_') if any(others) else [])
        return [
            features
            | path
            | {'shared': shared, 'tuning': int(tuning[0]), 'renewed': list(islice(looks, count))}
            for count, features, path, shared, tuning in columns
        ]
    except DAMAGES as error:
        raise InputError(f'{path} is missing, cut off or damaged: {error}; {AGAIN}') from None


def _split(
    arrays: Mapping[str, Any], names: Sequence[str], counts: Any, prefix: str = ''
) -> list[dict[str, Any]]:
    """Return the columns of each key view or photograph, which have so many rows."""
    parts = [np.split(arrays[f'{prefix}{name}'], np.cumsum(counts)[:-1]) for name in names]
    return [dict(zip(names, columns, strict=True)) for columns in zip(*parts, strict=True)]


def _key_view(
    row: _Row, loads: Sequence['StoredPhotograph'], part: Mapping[str, Any]
) -> RouteView:
    keypoints, path, shared = _keypoints(part, part['tuning']), part['path'], part['shared']
    offsets, inverse_depth, covariance = (part[name].astype(np.float64) for name in STRUCTURES)
    structure = LocalStructure(
        keypoints.pixels,
        offsets.T,
        inverse_depth,
        covariance.transpose(1, 2, 0),
        shared[:SHARED],
        *[*shared[SHARED:].tolist(), FORMER_NOISE_PX][:2],
    )
    if not all(np.isfinite(getattr(structure, item.name)).all() for item in fields(structure)):
        raise ValueError('a structure must be finite')
    renewed = tuple(
        Appearance(load, _keypoints(look, part['tuning']), look['rows'])
        for load, look in zip(loads[1:], part['renewed'], strict=True)
    )
    if any(look.rows.max(initial=0) >= len(keypoints) for look in renewed):
        raise ValueError('a photograph of another day has features that the key view has not')
    taught = TaughtPath(path[:, 0], path[:, 1:4], path[:, 4], path[:, 5])
    return RouteView(
        loads[0],
        keypoints,
        structure,
        taught,
        row.way,
        row.pose,
        row.is_station,
        renewed,
        row.bridge,
    )


def _keypoints(columns: Mapping[str, Any], tuning: int) -> Keypoints:
    pixels, sizes, angles, descriptors = (columns[it].astype(np.float64) for it in KEYPOINTS)
    return Keypoints(pixels, sizes, angles, descriptors.astype(np.float32), tuning)


def _read(path: Path, sha256: str | None) -> bytes:
    """Return the content of a part; raises OSError, or ValueError if it has another hash."""
    content = path.read_bytes()
    if sha256 not in (None, _hash(content)):
        raise ValueError(f'it is not that of this route, its hash in {ROUTE} differs')
    return content


@dataclass(frozen=True, slots=True)
class StoredPhotograph:
    """A photograph of ``shape`` (H, W) on the disk, decoded when it is called."""

    folder: Path
    name: str
    shape: tuple[int, int]
    sha256: str | None  # that it is compared with at once, so that no robot begins with another

    def __post_init__(self) -> None:
        if self.sha256 is not None:
            self.read()

    def read(self) -> bytes:
        """Return the file as it is; InputError with what is wrong with it."""
        path = place_of(self.folder, self.name)
        try:
            return _read(path, self.sha256)
        except (OSError, ValueError) as error:
            raise InputError(f'{path}: the photograph cannot be read: {error}; {AGAIN}') from None

    def __call__(self) -> Image:
        """Return the image; InputError with what is wrong with it."""
        path, (height, width) = self.folder / self.name, self.shape
        try:
            image = encodings.decode(self.read(), str(path))
        except ValueError as error:
            raise InputError(f'{path}: the photograph cannot be read: {error}; {AGAIN}') from None
        if image.shape != self.shape or image.dtype != np.uint8:
            raise InputError(
                f'{path} must have {width}x{height} grey pixels of 8 bits as the camera of the '
                f'route, got {image.shape[1]}x{image.shape[0]} of {image.dtype}; {AGAIN}'
            )
        return np.asarray(image, np.uint8)
