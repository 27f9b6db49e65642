"""The photographer of the tracker: captures the goal from the last images, and keeps it."""

from collections import deque
from dataclasses import replace
from pathlib import Path

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.plausibility import are_alike, differences
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.tracking.photographs import at_rest, averaged
from visual_servo_epipolar.nodes import photograph
from visual_servo_epipolar.nodes.photograph import Photograph
from visual_servo_epipolar.nodes.steady import SILENT_S, Stopwatch


class Renewal:
    """Renewal of photographs: due once ``frames`` images after an arrival, if none follows it."""

    def __init__(self, frames: int) -> None:
        self._frames, self._left = frames, 0
        self._phase = ''

    def follow(self, phase: str) -> None:
        """Note the phase of the servo, which says with each image that it has arrived."""
        if phase != Phase.ARRIVED.value:
            self._left = 0
        elif self._phase not in ('', phase):  # it was seen to arrive
            self._left = self._frames
        self._phase = phase

    def is_due(self) -> bool:
        """Return whether it is due with this image; ask once for each."""
        if self._left == 0:
            return False
        self._left -= 1
        return self._left == 0


class Photographer:
    """Photographer of the mean of the last ``frames`` alike, kept at ``path`` if one is given."""

    def __init__(self, frames: int, path: str) -> None:
        self._recent: deque[Image] = deque(maxlen=frames)
        self._path = Path(path) if path else None
        self._seen = Stopwatch()
        self._photograph: Photograph | None = None

    def load(self) -> tuple[Image, ...]:
        """Return the photographs that were kept, the first first; raises ValueError if broken."""
        kept = None if self._path is None else photograph.load(self._path)
        if kept is None:
            return ()
        self._photograph = kept
        return kept.image, *kept.more

    def see(self, image: Image | None) -> None:
        """Take in an image; None is one that cannot be used."""
        if image is None:
            self._recent.clear()
        else:
            self._recent.append(image)
            self._seen.start()

    def capture(self) -> tuple[Image, int]:
        """Return the photograph, and of how many images it is; raises ValueError if it is none."""
        if not self._recent:
            raise ValueError('no usable image is there; check image_raw and camera_info')
        age = self._seen.seconds
        if age > SILENT_S:
            raise ValueError(f'the last image is {age:.1f} s old; check the camera')
        images = list(reversed(self._recent))
        count, unrest = at_rest(images)
        if count == 1 and unrest:
            raise ValueError(
                f'the last two images differ: {unrest}; let the robot stand, and capture again'
            )
        return averaged(images[:count]), count

    def keep(self, image: Image, count: int, camera: CameraModel, stamp_ns: int) -> str:
        """Keep what was captured, if it is to be kept; return in words what became of it."""
        self._photograph = Photograph(image, camera, stamp_ns, count)
        return self._keep(self._photograph)

    def keep_more(self, images: tuple[Image, ...]) -> str:
        """Keep these beside what was captured; return in words what became of them."""
        if self._path is None:
            return ''
        if self._photograph is None:
            return ', but it is not kept, for the first one was not captured'
        self._photograph = replace(self._photograph, more=images)
        return self._keep(self._photograph)

    def _keep(self, captured: Photograph) -> str:
        if self._path is None:
            return ''
        try:
            photograph.keep(self._path, captured)
        except OSError as error:
            return f', but it is not kept: {self._path}: {error.strerror}'
        return f', kept in {self._path}'

    def forget_camera(self) -> None:
        """Forget which camera the photograph was taken with: it came from elsewhere."""
        self._photograph = None

    def complaint(self, camera: CameraModel | None) -> str:
        """Return that the photograph was taken with another camera than this, or ''."""
        if self._photograph is None or camera is None:
            return ''
        taken_with = self._photograph.camera
        if are_alike(taken_with, camera):
            return ''
        return (
            'the photograph was taken with another camera: '
            f'{differences(taken_with, camera)}; capture it anew'
        )
