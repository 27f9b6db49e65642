"""Recording of a way: images and metres in, a route out; and its renewal by later arrivals."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

from visual_servo_epipolar.core.arrays import Image
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import InputError, VisualServoError
from visual_servo_epipolar.core.routes.driven_images import DrivenImages, MOST_WAITING
from visual_servo_epipolar.core.routes.route import Route
from visual_servo_epipolar.core.routes.run import RouteRun
from visual_servo_epipolar.core.routes.settings import TeachSettings
from visual_servo_epipolar.core.routes.teaching import Teacher
from visual_servo_epipolar.core.twoview.estimator import Attitude
from visual_servo_epipolar.messages.route_folder import write_route

ResultT = TypeVar('ResultT')
MOST_UNLEARNT = 300  # images that wait to be learnt from


class RouteRecording:
    """
    Recording of a way by ``camera``, of ``images`` that are placed on the driven path.

    A key view is learnt in half a second, in which images go on to come: they are learnt from one
    after the other, on a thread of their own. Their ``trouble`` says why no route comes of it.
    """

    def __init__(
        self, camera: CameraModel, settings: TeachSettings, mount: Attitude, images: DrivenImages
    ) -> None:
        self.camera, self.images = camera, images
        self._teacher = Teacher(camera, settings, mount)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix='route_recording')
        self._learning: deque[Future[None]] = deque()

    @property
    def key_views(self) -> int:
        """The number of key views so far."""
        return self._teacher.key_views

    @property
    def notes(self) -> list[str]:
        """What odometry bridges, how it differs from the images, and which are left out."""
        return [*self._teacher.notes, *self.images.notes]

    @property
    def behind(self) -> int:
        """The number of images that wait to be learnt from."""
        return sum(not step.done() for step in self._learning)

    def see(self, image: Image, stamp_ns: int) -> None:
        """Take in an image of the way, uint8 of shape (H, W)."""
        self.images.see(image, stamp_ns)
        self.look_at_waiting()
        if self.images.unplaced > MOST_WAITING:
            self.images.finish()

    def look_at_waiting(self) -> None:
        """Learn from the images that the driven path reaches by now."""
        for image, stamp_ns, pose in self.images.placed():
            self._submit(self._teacher.add, image, stamp_ns, pose)
        self._collect()

    def station(self) -> None:
        """Mark where the robot stands as a station; raises what is wrong."""
        if self.images.missing:
            raise InputError(self.images.missing)
        self._finished(self._thread.submit(self._teacher.station))

    def finish(self) -> Route:
        """Return the route; raises InputError where none can be learnt."""
        self.images.finish()
        try:
            return self._finished(self._thread.submit(self._teacher.finish))
        finally:
            self.close()

    def close(self) -> None:
        """End the thread; what still waits is not learnt from."""
        self._thread.shutdown(cancel_futures=True)

    def _submit(self, learn: Callable[..., None], *what: object) -> None:
        self._learning.append(self._thread.submit(learn, *what))
        if self.behind > MOST_UNLEARNT:
            self.images.trouble = (
                f'{MOST_UNLEARNT} images wait to be learnt from; send smaller images or fewer, '
                'and record the way anew'
            )

    def _collect(self) -> None:
        """Take note of what was wrong with images that were learnt from."""
        while self._learning and self._learning[0].done():
            error = self._learning.popleft().exception()
            if error is not None and not self.images.trouble:
                self.images.trouble = str(error)

    def _finished(self, future: 'Future[ResultT]') -> ResultT:
        """Return what a step of the thread returns, after all images before it."""
        try:
            result = future.result()
        except (ValueError, VisualServoError) as error:
            self._collect()
            raise InputError(self.images.trouble or str(error)) from None
        self._collect()
        if self.images.trouble:
            raise InputError(self.images.trouble)
        return result


class RouteRenewal:
    """Renewal of a route in its folder after an arrival, on a thread of its own."""

    def __init__(self, logger: Any) -> None:
        self._logger, self._thread = logger, ThreadPoolExecutor(1, 'route_renewal')
        self._run: RouteRun | None = None
        self._folder, self._writing = Path(), self._thread.submit(lambda: None)

    def follow(self, run: RouteRun, folder: Path) -> None:
        """Watch another run, whose route is in a ``folder``."""
        self._run, self._folder = run, folder

    def begin(self) -> None:
        """Write what the run that is watched has confirmed, once it has arrived."""
        run, self._run = self._run, None
        if run is not None and run.settings.renewals:
            self._writing = self._thread.submit(self._write, run, self._folder)

    def wait(self) -> None:
        """Wait until the folder is written."""
        self._writing.result()

    def _write(self, run: RouteRun, folder: Path) -> None:
        try:
            count = run.confirmed
            if count:
                write_route(run.renewed(), folder)
                self._logger.info(f'{count} key views have photographs of today, in {folder}')
        except VisualServoError as error:
            self._logger.warning(f'no photographs of today are kept: {error}')
