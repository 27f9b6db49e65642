"""Camera files: YAML, JSON, XML and ost.txt of other programs' calibrations, and back."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
import json
import re
from typing import Any
from xml.etree import ElementTree

import yaml

from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.messages import read
from visual_servo_epipolar.messages.calibration import (
    Calibration,
    Cameras,
    cameras_by_keys,
    kalibr_cameras,
)

DOCUMENTS = 100  # of a text that are looked at: a console prints one a message
OST_SECTION, OST_NUMBERS = re.compile(r'\[(.+)\]'), re.compile(r'[-+.\deE\s]+|.*\b(nan|inf)\b.*')
OST_KEYS = {
    'width': 'image_width',
    'height': 'image_height',
    'camera matrix': 'camera_matrix',
    'distortion': 'distortion_coefficients',
    'projection': 'projection_matrix',
}


class _Loader(yaml.SafeLoader):
    """Loader that takes what a tag marks for what it is: OpenCV's matrices are mappings."""


def _without_tag(loader: _Loader, tag: str, node: Any) -> Any:
    if isinstance(node, yaml.MappingNode):
        return loader.construct_mapping(node, deep=True)
    if isinstance(node, yaml.SequenceNode):
        return loader.construct_sequence(node, deep=True)
    return loader.construct_scalar(node)


_Loader.add_multi_constructor('', _without_tag)


def documents(text: str) -> list[Any]:
    """
    Return the documents in a text, one for each ``---`` of YAML.

    Raises ValueError if it cannot be parsed.
    """
    start = text.lstrip()
    try:
        if start.startswith('<'):
            return [_of_xml(ElementTree.fromstring(start))]
        if re.search(r'^\[image\]', text, re.MULTILINE):
            return list(_of_ost(text))
        if start.startswith('{'):
            return [_of_json(start)]
        return list(_of_yaml(text))
    except ElementTree.ParseError as error:
        raise ValueError(f'camera file is not XML: {error}') from None
    except yaml.YAMLError as error:
        raise ValueError(f'camera file is not YAML: {_in_a_line(error)}') from None
    except ValueError:  # of a date, or a number of too many digits
        raise ValueError('camera file is not YAML: it has a value that cannot be read') from None
    except RecursionError:
        raise ValueError('camera file is nested too deeply') from None


def _of_json(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:  # YAML in one line begins like that, too
        return yaml.load(text, _Loader)


def _of_yaml(text: str) -> Iterator[Any]:
    """Yield documents; the last may be cut off, as where a console was interrupted."""
    lines = (line for line in text.splitlines(keepends=True) if not line.startswith('%'))
    chunks = re.split(r'^---(?:\s|$)', ''.join(lines), flags=re.MULTILINE)
    whole = [chunk for chunk in chunks if chunk.strip()][:DOCUMENTS] or ['']
    for index, chunk in enumerate(whole):
        try:
            document = yaml.load(chunk, _Loader)
        except yaml.YAMLError:
            if index == 0:
                raise
            return
        if document is not None or len(whole) == 1:
            yield document


def _of_xml(element: ElementTree.Element) -> Any:
    """Return an element as in OpenCV's FileStorage: children by name, or a text."""
    if len(element):
        return {child.tag: _of_xml(child) for child in element}
    return (element.text or '').strip().strip('"')


def _of_ost(text: str) -> Iterator[dict[str, Any]]:
    """Yield the cameras of an ost.txt, one for each section [image]."""
    for part in re.split(r'^\[image\]', text, flags=re.MULTILINE)[1:]:
        document: dict[str, Any] = {}
        key = ''
        for line in map(str.strip, part.splitlines()):
            if line.startswith('#') or OST_SECTION.fullmatch(line):
                key = ''
            elif line and OST_NUMBERS.fullmatch(line) and key:
                document[key] = f'{document.get(key, "")} {line}'.strip()
            elif line:
                key = OST_KEYS.get(line, '')
                if key:
                    document[key] = ''
        yield document


def _in_a_line(error: yaml.YAMLError) -> str:
    problem, mark = getattr(error, 'problem', None), getattr(error, 'problem_mark', None)
    where = '' if mark is None else f' in line {mark.line + 1}'
    return f'{problem or "it cannot be read"}{where}'


KINDS = (
    "camera_calibration's ost.yaml and ost.txt, ros2 topic echo of a camera_info, OpenCV's "
    "FileStorage (YAML, XML, JSON), Kalibr's camchain"
)
# Images of both begin at the edge of their first pixel, ours in its middle.
CONVERTED = (
    'camera file is of {}, which is not read; write it as YAML: image_width, image_height, '
    'camera_matrix [fx, 0, cx - 0.5, 0, fy, cy - 0.5, 0, 0, 1], distortion_model plumb_bob or '
    'equidistant, distortion_coefficients [k1, k2, p1, p2] or [k1, k2, k3, k4]'
)
COLMAP_LINE = re.compile(r'\d+ [A-Z][A-Z_0-9]+ \S+ \S+ .*', re.DOTALL)
NERFSTUDIO_KEYS = {'fl_x', 'camera_angle_x', 'frames'}
READERS = (kalibr_cameras, cameras_by_keys)
NAMED = 5  # of the cameras of a file, in a message


def from_text(
    text: str,
    *,
    name: str = '',
    size: tuple[int, int] | None = None,
    rectified: bool = False,
    cropped: bool = False,
) -> CameraModel:
    """
    Return the camera of a file, that of ``name`` where it has several.

    ``size`` [px] is that of the images, for files that have none. Of ``rectified`` images
    projection_matrix alone holds; those that are ``cropped`` have their principal point anywhere.

    Raises ValueError if the file is none of KINDS, lacks something, or is of no camera that
    can be used.
    """
    text = text.removeprefix('\ufeff')  # as editors of Windows begin a file
    calibration = _with_size(_chosen(_cameras(documents(text)), name), size)
    if rectified and not calibration.p:
        raise ValueError(
            "camera file lacks 'projection_matrix', which rectified images need; write it with "
            'camera_calibration'
        )
    return read.camera(calibration, rectified=rectified, cropped=cropped)


def from_document(document: Any) -> CameraModel:
    """Return the camera of a parsed file that was written for images that were used."""
    return read.camera(_with_size(_chosen(_cameras([document]), ''), None), cropped=True)


def to_document(camera: CameraModel) -> dict[str, Any]:
    """Return what ``from_document`` makes this camera of."""
    return {
        'image_width': camera.width,
        'image_height': camera.height,
        'camera_matrix': _matrix(3, 3, camera.matrix.ravel().tolist()),
        'distortion_model': camera.distortion_model,
        'distortion_coefficients': _matrix(1, len(camera.distortion), list(camera.distortion)),
    }


def _matrix(rows: int, cols: int, data: list[float]) -> dict[str, Any]:
    return {'rows': rows, 'cols': cols, 'data': [float(value) for value in data]}


def _cameras(parsed: list[Any]) -> Cameras:
    """Return the cameras of documents; alike ones, as a console prints them, once."""
    found: dict[str, Any] = {}
    known: list[Any] = []
    for index, document in enumerate(parsed):
        if isinstance(document, str) and COLMAP_LINE.fullmatch(document):
            raise ValueError(CONVERTED.format('COLMAP'))
        if not isinstance(document, Mapping):
            raise ValueError(f'a camera file must map names to values; supported are {KINDS}')
        if NERFSTUDIO_KEYS & document.keys():
            raise ValueError(CONVERTED.format('nerfstudio'))
        content = {key: value for key, value in document.items() if key != 'header'}
        if content in known:
            continue
        known.append(content)
        for read_cameras in READERS:
            cameras = read_cameras(content)
            if cameras:
                found |= {name or str(index + 1): camera for name, camera in cameras.items()}
                break
    if not found:
        raise ValueError(f"camera file lacks 'camera_matrix'; supported are {KINDS}")
    return found


def _chosen(cameras: Cameras, name: str) -> Calibration:
    """Return the calibration of ``name``, or of the only camera there is."""
    if name not in cameras and (name or len(cameras) > 1):
        names = ', '.join([*cameras][:NAMED]) + (', ...' if len(cameras) > NAMED else '')
        raise ValueError(
            f'the file has the cameras {names}, got {name or "no name"}; choose one, as in '
            f'FILE#{next(iter(cameras))}'
        )
    return cameras[name or next(iter(cameras))]()


def _with_size(calibration: Calibration, size: tuple[int, int] | None) -> Calibration:
    if calibration.width:
        return calibration
    if size is None:
        raise ValueError(f'camera file has no image size; add {calibration.size_keys} to it')
    return replace(calibration, width=size[0], height=size[1])
