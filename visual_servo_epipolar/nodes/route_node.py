"""The route node: a way is recorded by photographs, and repeated; the core decides how."""

from collections.abc import Callable
from pathlib import Path
import sys
from typing import Any

from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.cameras.equirectangular import cut_note
from visual_servo_epipolar.core.cameras.plausibility import differences
from visual_servo_epipolar.core.cameras.registry import CAMERA_INFO, camera_of_size
from visual_servo_epipolar.core.errors import InputError, VisualServoError
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.core.routes.route import Route
from visual_servo_epipolar.core.routes.run import refuse_heads, RouteRun
from visual_servo_epipolar.core.routes.settings import FollowSettings, TeachSettings
from visual_servo_epipolar.core.routes.teaching import DrivenImages
from visual_servo_epipolar.core.servo.run import Run
from visual_servo_epipolar.core.servo.settings import ServoSettings, StationSettings
from visual_servo_epipolar.core.servo.state import ServoState
from visual_servo_epipolar.core.twoview.estimator import Attitude
from visual_servo_epipolar.messages import read, validation
from visual_servo_epipolar.messages.route_folder import (
    check_folder,
    is_route,
    read_route,
    write_route,
)
from visual_servo_epipolar.nodes import parameters
from visual_servo_epipolar.nodes.camera_subscriptions import CameraSubscriptions
from visual_servo_epipolar.nodes.commands import Commands, conflict
from visual_servo_epipolar.nodes.driving_inputs import DrivenPath, ServoCamera
from visual_servo_epipolar.nodes.managed import carry_out, in_every_state, ManagedNode, serve
from visual_servo_epipolar.nodes.reports import Complaints
from visual_servo_epipolar.nodes.route_runs import (
    RouteRecording,
    RouteRenewal,
    RouteRepetition,
    RouteReports,
)
from visual_servo_epipolar.nodes.startup.run import spin
from visual_servo_epipolar.nodes.startup.settings import RouteNodeSettings
from visual_servo_epipolar.nodes.steady import SILENT_S
from visual_servo_epipolar.nodes.watching import Enable, StopButton


class RouteNode(ManagedNode):
    """
    Hosts ``core.routes``: images along a way in, a folder out; later images in, commands out.

    Outside of a repetition it is silent: somebody drives by hand while a way is recorded.
    """

    one_core = True  # of OpenCV: more threads would wait for cores that others have

    def __init__(self, **options: Any) -> None:
        super().__init__('route_node', **options)
        self._warn = Complaints(self)
        self._node_settings = parameters.declare(self, RouteNodeSettings)
        self._servo: ServoSettings = parameters.declare(self, StationSettings)
        self._follow = parameters.declare(self, FollowSettings)
        self._teach = parameters.declare(self, TeachSettings)
        parameters.finish(self, options)
        parameters.watch(self, '_node_settings')
        parameters.watch(self, '_teach')
        parameters.watch(self, '_servo', self._use)
        parameters.watch(self, '_follow', self._use)
        self._stop_button = StopButton(self, self._stop, again='~/repeat')
        self._begins = self._servo.autostart
        actions: dict[str, Callable[[], str]] = {
            'start_recording': self._start_recording,
            'station': self._station,
            'stop_recording': self._stop_recording,
            'repeat': self._repeat,
            'cancel': self._cancel,
        }
        for name, action in actions.items():
            serve(self, f'~/{name}', action, done=name + ': {}', refused=name + ' refused: {}')
        self.autostart(self._node_settings)

    def configure(self) -> None:
        """Create all that recording and repeating need."""
        refuse_heads(self._servo)
        settings = self._node_settings
        self.received = 0  # images
        self._recording: RouteRecording | None = None
        self._renewal = RouteRenewal(self.get_logger())
        self._taught: Route | None = None  # and not written yet
        self._camera = ServoCamera(self, settings, self._warn)
        self._driven = DrivenPath(self, self._warn_of_path, settings, self._on_odometry)
        self._commands, self._reports = Commands(self, settings), RouteReports(self)
        self._enable = Enable(
            self, settings.enable_timeout, lambda reason: self._repetition.lose(reason)
        )
        self._repetition = RouteRepetition(
            self,
            self._commands,
            self._reports,
            self._enable.withheld,
            lambda: self._servo.stale_timeout,
            watched=settings.watchdog,
        )
        self._inputs = CameraSubscriptions(self, settings.transport, settings.camera_reliability)
        if settings.projection == CAMERA_INFO:
            self._inputs.create_subscription(CameraInfo, 'camera_info', self._on_info)
        self._inputs.create_subscription(Image, 'image_raw', self._on_image)

    def activate(self) -> None:
        """Show the route that is there, if any, and wait for a service, or drive at once."""
        self._driven.begin_anew()
        if self._node_settings.route and is_route(self._folder()):
            self._reports.route(read_route(self._folder()))
        self._reports.standing(self._repetition.last)

    def deactivate(self) -> None:
        """Stop the robot; a way that is being recorded is lost, which is logged."""
        self._stop('deactivated')
        self._commands.wait()
        if self._recording is not None:
            self.get_logger().warning('the recording of a way is given up')
            self._recording.close()
            self._recording = None

    def stop(self) -> None:
        """Stop the robot, and wait until the command is acknowledged."""
        self._stop('')
        if self.is_configured:
            self._commands.wait()

    suspend = stop  # also before the process sleeps

    @property
    def phase(self) -> str:
        """The phase of the repetition, by the last image or order."""
        return self._repetition.last.phase

    def _stop(self, reason: str) -> None:
        """End a repetition; none begins by itself after that."""
        self._begins = False
        if self.is_configured:
            self._repetition.stop(reason)

    def _use(self) -> None:
        """Let a repetition that is under way go on by the settings in force."""
        if self.is_configured:
            self._repetition.use(self._follow, self._servo)

    def _warn_of_path(self, text: str) -> None:
        if self._recording is not None:  # a repetition needs none
            self._warn(text)

    def _on_odometry(self) -> None:
        if self._recording is not None:
            self._recording.look_at_waiting()

    @in_every_state  # camera_info may be latched
    def _on_info(self, message: CameraInfo) -> None:
        self._inputs.info_frame = message.header.frame_id
        self._camera.hear(message, Run(), self._servo)
        trouble = self._foreign
        if trouble:
            self._repetition.fail(trouble)

    @property
    def _foreign(self) -> str:
        """That the camera is not that of the repetition or of the recording; or ''."""
        run, recording, camera = self._repetition.run, self._recording, self._camera.model
        if camera is None:
            return self._missing if self._repetition.is_active else ''
        if recording is not None and camera != recording.camera:
            recording.images.trouble = (
                'camera_info has changed while recording: '
                f'{differences(recording.camera, camera)}; record the way anew'
            )
        try:
            if run is not None:
                run.taught.check_camera(camera)
        except InputError as error:
            return str(error)
        if run is None or camera == run.route.camera:
            return ''
        change = differences(run.route.camera, camera)
        return f'camera_info has changed in mid-run: {change}; call ~/repeat again'

    def _on_image(self, message: Image | CompressedImage) -> None:
        self.received += 1
        self._repetition.freshness.heard.start()
        self._inputs.compare_frames(message.header.frame_id)
        by_info = self._node_settings.projection == CAMERA_INFO
        if by_info and self._camera.model is None:
            self._warn(self._camera.missing)
            return
        try:
            image = read.gray(message)
            if self._camera.model is None:
                size = image.shape[1], image.shape[0]
                self._camera.model = camera_of_size(self._node_settings.projection, size)
                if note := cut_note(self._camera.model):
                    self.get_logger().warning(note)
            validation.checked_image(image, self._camera.model)
        except ValueError as error:
            self._warn(f'image refused: {error}')
            self._repetition.lose(f'image refused: {error}')
            return
        self._take(image, read.stamp_ns(message.header), message.header.frame_id)

    @property
    def _missing(self) -> str:
        """Why there is no camera to go by; or ''."""
        if self._camera.model is None and self._node_settings.projection != CAMERA_INFO:
            return 'no image has come yet whose size tells the camera; is it running?'
        return self._camera.missing

    def _take(self, image: Pixels, stamp_ns: int, frame_id: str) -> None:
        """Record an image, or drive by it."""
        if self._recording is not None:
            self._recording.see(image, stamp_ns)
            if self._recording.images.trouble:
                self._warn(f'no route comes of it: {self._recording.images.trouble}')
        if self._begins:
            self._begins = False
            carry_out(self, self._repeat, 'repeat: {}', 'repeat refused: {}')
        if self._repetition.run is None:
            self._servo = self._camera.mounted(frame_id, ServoState(), self._servo)
        try:
            latency = self._node_settings.max_latency
            self._repetition.see(image, stamp_ns, frame_id, latency)
            if self.phase == Phase.ARRIVED.value:
                self._renewal.begin()
        except VisualServoError as error:  # a photograph on the disk that cannot be read
            self._repetition.fail(str(error))

    def _folder(self) -> Path:
        """Return the folder of the route; InputError if none is named."""
        if not self._node_settings.route:
            name = self.get_fully_qualified_name()
            raise InputError(
                f'the parameter route names no folder; set it: ros2 param set {name} route FOLDER'
            )
        return Path(self._node_settings.route)

    def _start_recording(self) -> str:
        """Begin to record; raises InputError where nothing could come of it."""
        check_folder(self._folder())
        if self._repetition.is_active:
            raise InputError('a repetition is under way; ~/cancel it first')
        if self._recording is not None:
            raise InputError('a way is being recorded; ~/stop_recording it first')
        if self._camera.model is None:
            raise InputError(self._missing)
        mount = Attitude(self._servo.camera_tilt, self._servo.camera_roll)
        self._taught = None
        self._driven.begin_anew()
        images = DrivenImages(self._driven.path, self._servo.stale_timeout)
        self._recording = RouteRecording(self._camera.model, self._teach, mount, images)
        return (
            'recording: drive the way by hand, stand where it shall end exactly, then call '
            '~/stop_recording'
        )

    def _station(self) -> str:
        if self._recording is None:
            raise InputError('no way is being recorded; call ~/start_recording first')
        self._recording.station()
        return f'a station, at key view {self._recording.key_views - 1}'

    def _stop_recording(self) -> str:
        """Write what was recorded; what could not be written is kept for another call."""
        recording, self._recording = self._recording, None
        notes: list[str] = []
        if recording is not None:
            self._taught, notes = recording.finish(), recording.notes
        if self._taught is None:
            raise InputError('no way is being recorded; call ~/start_recording first')
        route, folder = self._taught, self._folder()
        self._renewal.wait()
        write_route(route, folder)
        self._taught = None
        self._reports.route(route)
        written = f'{route.length:.2f} m, {len(route.views)} key views, written to {folder}'
        return '; '.join([written, *notes])

    def _repeat(self) -> str:
        """Let a repetition begin; raises InputError where it may not."""
        if self._repetition.is_active:
            return 'a repetition is under way'
        refusal = self._refusal()
        if refusal:
            raise InputError(refusal)
        self._renewal.wait()
        folder = self._folder()
        route = read_route(folder)
        camera = self._camera.model
        run = RouteRun(route, self._follow, self._servo, camera=camera)
        self._reports.route(route)
        settings = (self._node_settings, self._servo, self._follow)
        self._repetition.begin(run, settings)
        self._renewal.follow(run, folder)
        end = route.views[run.target].way
        begun = f'begun, to the station after {end:.2f} m; the robot looks where it is'
        if camera is not None and camera != route.camera:
            begun += f'; the camera was calibrated anew: {differences(route.camera, camera)}'
        return begun

    def _refusal(self) -> str:
        """Return why no repetition may begin now; or ''."""
        if self._stop_button.pressed:
            return self._stop_button.trouble
        if self._recording is not None:
            return 'a way is being recorded; ~/stop_recording it first'
        trouble = self._missing or self._camera.static_mount.trouble
        if trouble or not self._node_settings.watchdog:
            return trouble
        if self._repetition.freshness.heard.seconds > SILENT_S:
            return 'no images have come for a second; is the camera running?'
        return conflict(self) or self._enable.withheld()

    @in_every_state  # after a cancel the robot stands also when the node is active again
    def _cancel(self) -> str:
        self._stop('cancelled')
        return 'the robot stands'


if __name__ == '__main__':
    sys.exit(spin(RouteNode))
