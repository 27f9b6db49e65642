"""
The photograph as a file: a given picture, or a captured one with its camera.

What is captured is a camera file as camera_calibration writes it, which names the picture beside
it: ``visual_servo inspect`` takes both. The picture is there before the camera file is renamed to
its place, so that a crash leaves the former photograph or the new one, whole.
"""

from contextlib import suppress
from dataclasses import dataclass
import os
from pathlib import Path
from typing import Any

import cv2
import yaml

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.goal import goal_id
from visual_servo_epipolar.core.settings import LARGEST
from visual_servo_epipolar.files import whole, yaml_document
from visual_servo_epipolar.messages import camera_file, encodings
from visual_servo_epipolar.messages.camera_file import text, whole_number

PICTURES = frozenset({'.png', '.jpg', '.jpeg', '.tif', '.tiff', '.webp', '.bmp', '.pgm'})


@dataclass(frozen=True, slots=True, eq=False)
class Photograph:
    """
    Photograph: ``image``, uint8 of shape (H, W), of ``images``, with its camera and time.

    ``more`` are photographs of the same pose in other light.
    """

    image: Image
    camera: CameraModel
    stamp_ns: int = 0
    images: int = 1
    more: tuple[Image, ...] = ()


def read_picture(path: Path, name: str) -> Image:
    """Return the grey levels of a picture; raises OSError, or ValueError if it is none."""
    return encodings.picture(path.read_bytes(), name)


def read_photographs(given: str, most: int) -> dict[str, Image]:
    """
    Read the photographs that a parameter names, by path, or raise ValueError.

    It names a file, or a folder of ``most`` pictures at most, by name. The first one defines the
    goal.
    """
    files = _photograph_files(given)
    if len(files) > most:
        raise ValueError(
            f'desired_image must name at most {most} photographs, got {len(files)} by {given!r}; '
            'name fewer'
        )
    return {file: _read_photograph(file) for file in files}


def _photograph_files(given: str) -> list[str]:
    if not os.path.isdir(given):
        return [given]
    try:
        files = sorted(it for it in Path(given).iterdir() if _is_picture(it))
    except OSError as error:
        raise ValueError(
            f'desired_image must be a folder that can be read, got {given!r}: {error.strerror}; '
            'let the tracker read it'
        ) from None
    if not files:
        raise ValueError(
            f'desired_image must be a folder with pictures, got {given!r}, where none is; '
            'put them there'
        )
    return list(map(str, files))


def _is_picture(path: Path) -> bool:
    """Return whether a file in a folder is a picture by its name; macOS puts ._NAME beside."""
    is_shown = path.suffix.lower() in PICTURES and not path.name.startswith('.')
    return is_shown and not path.is_dir()


def _read_photograph(path: str) -> Image:
    try:
        return read_picture(Path(path), path)
    except (OSError, ValueError) as error:
        reason = getattr(error, 'strerror', None) or error
        raise ValueError(
            f'desired_image must be a readable image file, got {path!r}: {reason}'
        ) from None


def load(path: Path) -> Photograph | None:
    """Return the photograph that was kept, None if there is none; raises ValueError if broken."""
    check(path)
    if not path.exists():
        return None
    try:
        document = yaml_document(path.read_text(encoding='utf-8'))
        camera = camera_file.from_document(document)
        picture = path.with_name(Path(text(document.get('photograph'), 'photograph')).name)
        image = None
        with suppress(FileNotFoundError, ValueError):
            image = read_picture(picture, picture.name)
        stamp_ns = whole_number(document.get('stamp_ns'), 'stamp_ns', 0, LARGEST - 1)
        images = whole_number(document.get('images', 1), 'images', 1, LARGEST - 1)
        first = _check_picture(image, camera, document)
        more = tuple(read_picture(path.with_name(name), name) for name in _more(document))
        photograph = Photograph(first, camera, stamp_ns, images, more)
    except (OSError, ValueError) as error:
        reason = ' '.join(str(error).split())
        raise ValueError(
            f'photograph {path} cannot be used: {reason:.200}; move it away, and capture anew'
        ) from None
    return photograph


def check(path: Path) -> None:
    """Raise ValueError for a path where no photograph can be kept."""
    if path.suffix not in ('.yaml', '.yml') or path.is_dir():
        raise ValueError(f'photograph must be the name of a .yaml file, got {str(path)!r}')
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise ValueError(
            f'photograph must lie in a folder that can be written, got {str(path)!r}; make it'
        )


def keep(path: Path, photograph: Photograph) -> None:
    """Keep a photograph in place of the former one; raises OSError if that cannot be done."""
    images = photograph.image, *photograph.more
    pictures = [path.with_name(f'{path.stem}-{goal_id(image):08x}.png') for image in images]
    document = {
        'photograph': pictures[0].name,
        'stamp_ns': photograph.stamp_ns,
        'images': photograph.images,
        'goal': goal_id(photograph.image),
        **({'more': [picture.name for picture in pictures[1:]]} if photograph.more else {}),
        **camera_file.to_document(photograph.camera),
    }
    encoded = [cv2.imencode('.png', image)[1].tobytes() for image in images]
    head = '# The photograph of a tracker_node, and the camera it was taken with.\n'
    text = head + yaml.safe_dump(document, sort_keys=False)
    for file, content in zip((*pictures, path), (*encoded, text.encode()), strict=True):
        with whole(file) as partial:
            partial.write_bytes(content)
    for former in path.parent.glob(f'{path.stem}-{"[0-9a-f]" * 8}.png'):
        if former not in pictures:
            former.unlink(missing_ok=True)


def _more(document: Any) -> list[str]:
    """Return the names of the pictures in other light, or raise ValueError."""
    more = document.get('more', [])
    if not isinstance(more, list):
        raise ValueError(f'more must be a list of pictures, got {more!r}')
    return [Path(text(name, 'more')).name for name in more]


def _check_picture(image: Image | None, camera: CameraModel, document: Any) -> Image:
    """Return the picture of a camera file, or raise ValueError if it is not that."""
    if image is None:
        raise ValueError(f'its picture {document["photograph"]} is missing or broken')
    height, width = image.shape
    if (width, height) != (camera.width, camera.height):
        raise ValueError(
            f'its picture has {width}x{height} px, its camera {camera.width}x{camera.height}'
        )
    if goal_id(image) != document.get('goal'):
        raise ValueError(f'its picture {document["photograph"]} is another one')
    return image
