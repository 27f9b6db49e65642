"""The tracker: images in, features of the desired view out."""

from dataclasses import replace
import sys
from typing import Any

from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2
from std_msgs.msg import String

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.cameras.equirectangular import cut_note
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.cameras.registry import CAMERA_INFO
from visual_servo_epipolar.core.errors import TrackingError
from visual_servo_epipolar.core.servo.admission import Repetition
from visual_servo_epipolar.core.stamps import seconds_between
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.tracking.tracker import Tracker
from visual_servo_epipolar.messages import event_log, read, write
from visual_servo_epipolar.messages.tracking import track, TrackingResult
from visual_servo_epipolar.nodes import parameters, qos
from visual_servo_epipolar.nodes.camera_subscriptions import CameraSubscriptions
from visual_servo_epipolar.nodes.managed import in_every_state, ManagedNode, serve
from visual_servo_epipolar.nodes.photograph import read_photographs
from visual_servo_epipolar.nodes.photographer import Photographer, Renewal
from visual_servo_epipolar.nodes.reports import Complaints
from visual_servo_epipolar.nodes.startup.run import spin
from visual_servo_epipolar.nodes.startup.settings import TrackerNodeSettings
from visual_servo_epipolar.nodes.steady import PATIENCE_S
from visual_servo_epipolar.nodes.tracker_reports import TrackerReports


class TrackerNode(ManagedNode):
    """
    Hosts a ``Tracker``; publishes one cloud for each image, empty when nothing is to be trusted.

    An empty cloud is what stops the servo: silence would have to wait for its watchdog.
    """

    one_core = True  # of OpenCV: more threads would wait for cores that others have
    sends_images = True

    def __init__(self, **options: Any) -> None:
        super().__init__('tracker_node', **options)
        self._warn = Complaints(self)
        self._node_settings = parameters.declare(self, TrackerNodeSettings)
        self._settings = parameters.declare(self, TrackerSettings)
        parameters.finish(self, options)
        parameters.watch(self, '_settings', self._use)
        parameters.watch(self, '_node_settings', self._announce)
        self._tracker = Tracker(self._settings)
        serve(self, '~/capture_desired', self._on_capture, 'captured: {}', 'not captured: {}')
        serve(self, '~/redetect', self._on_redetect, '{}', 'not redetected: {}')
        self.autostart(self._node_settings)

    def configure(self) -> None:
        """Create all that tracking needs; raises ValueError for a photograph that is broken."""
        self._tracker = Tracker(self._settings)
        self._stamp_ns: int | None = None
        self._frame_id = ''
        self._camera: CameraModel | None = None
        self._told: CameraModel | None = None  # that this node publishes
        self._silent_ns: int | None = None  # since when another node only advertises one
        self._unusable = ''  # why the last camera_info cannot be used
        self._repetition = Repetition()
        self._pending_image: Image | CompressedImage | None = None
        self._tracks_pub = self.create_publisher(PointCloud2, 'tracks', qos.STREAM)
        self._reports = TrackerReports(self)
        self._photographer = Photographer(
            self._node_settings.capture_frames, self._node_settings.photograph
        )
        self._renewal = Renewal(self._node_settings.capture_frames)
        self._load_photograph()
        self._create_subscriptions()

    def activate(self) -> None:
        """Match the next image anew: the robot may have been driven elsewhere meanwhile."""
        if self._tracker.has_desired:
            self._tracker.redetect()
            self._reports.desired(self._tracker.photographs.images[0], self._stamp_ns)
        self._reports.expect_images()
        self._announce()

    def deactivate(self) -> None:
        """Tell the servo at once that there are no tracks any more; photograph and camera stay."""
        if self._stamp_ns is not None:
            nothing = write.features(
                Features(goal=self._tracker.goal.id), self._stamp_ns + 1, self._frame_id
            )
            self._tracks_pub.publish(nothing)
            self._tracks_pub.wait_for_all_acked(qos.ACKNOWLEDGEMENT)
        self._pending_image = None
        self._photographer.see(None)

    @property
    def ready(self) -> bool:
        """Whether the photograph is there."""
        return self._tracker.has_desired

    def _create_subscriptions(self) -> None:
        settings = self._node_settings
        self._info_pub = None
        if settings.projection != CAMERA_INFO:
            self._info_pub = self.create_publisher(CameraInfo, 'camera_info', qos.STREAM)
        self._inputs = CameraSubscriptions(self, settings.transport, settings.camera_reliability)
        self._inputs.create_subscription(CameraInfo, 'camera_info', self._on_info)
        self._inputs.create_subscription(Image, 'image_raw', self._on_image)
        if settings.renew:
            self.create_subscription(
                String, 'phase', lambda phase: self._renewal.follow(phase.data), qos.LATCHED
            )
        if not settings.desired_image:
            self._inputs.create_subscription(
                Image, 'desired/image_raw', self._on_desired, qos.LATCHED
            )

    def _use(self) -> None:
        self._tracker.settings = self._settings
        self._announce()

    def _announce(self) -> None:
        """Publish the settings in force, so that a bag can be replayed with them."""
        if self.is_configured:
            self._reports.settings((self._node_settings, self._settings), self._stamp_ns)

    def _set_desired(self, image: Pixels) -> None:
        """Set the photograph and publish it; raises if it is unusable."""
        self._tracker.set_desired(image)
        self._reports.desired(image, self._stamp_ns)

    def _load_photograph(self) -> None:
        """Take photographs from files, if any are there; raises ValueError if one is broken."""
        given, name = self._node_settings.desired_image, self._node_settings.photograph
        kept = self._photographer.load()
        photographs = {name: kept[0]} if kept else {}
        if given:
            photographs = read_photographs(given, self._node_settings.max_photographs)
        photographs |= {f'{name}, number {k + 2}': image for k, image in enumerate(kept[1:])}
        for path, image in photographs.items():
            if self._tracker.has_desired:
                self._add_desired(image, path)
            else:
                self._set_desired(image)
        if photographs:
            several = f', {len(photographs)} photographs' if len(photographs) > 1 else ''
            self.get_logger().info(f'desired image is {given or name}{several}')

    def _add_desired(self, image: Pixels, name: str) -> None:
        """Add a photograph of the same pose; raises ValueError if it is none, or one too many."""
        most = self._node_settings.max_photographs
        if len(self._tracker.photographs) >= most:
            raise ValueError(
                f'{name} is one photograph more than the {most} of one pose that are used; begin '
                'anew without capture_adds'
            )
        try:
            self._tracker.add_desired(image)
        except (ValueError, TrackingError) as error:
            raise ValueError(f'{name} cannot be added: {error}') from None

    @in_every_state  # camera_info may be latched
    def _on_info(self, message: CameraInfo) -> None:
        self._inputs.info_frame = message.header.frame_id
        try:
            settings = self._node_settings
            camera = read.camera(message, rectified=settings.rectified, cropped=settings.cropped)
            if camera == self._told:  # from this node itself
                return
            self._camera = camera
            self._refuse_other(camera)
            self._unusable = ''
        except ValueError as error:
            self._camera, self._unusable = None, str(error)
            self._photographer.see(None)
        if self._pending_image is not None:
            pending, self._pending_image = self._pending_image, None
            self._on_image(pending)

    def _refuse_other(self, camera: CameraModel) -> None:
        """Raise ValueError where camera_info is not what the projection says."""
        projection = self._node_settings.projection
        if projection == CAMERA_INFO or camera.lens == projection:
            return
        topic = self.resolve_topic_name('camera_info')
        raise ValueError(
            f'projection is {projection}, but {topic} is of a {camera.lens} lens; remap '
            'camera_info of tracker and servo to a name of its own, or leave projection out'
        )

    def _on_image(self, message: Image | CompressedImage) -> None:
        by_info = self._node_settings.projection == CAMERA_INFO
        if by_info and self._camera is None and not self._unusable:
            self._pending_image = message
            self._warn('no usable camera_info yet; an image waits for it, the robot stands')
            self._reports.miss('images wait for a usable camera_info')
            return
        self._inputs.compare_frames(message.header.frame_id)
        tracking = track(
            self._tracker,
            message,
            self._camera or self._unusable,
            projection=self._node_settings.projection,
        )
        self._tell_camera(message, tracking.camera)
        self._repetition.see(tracking.image)
        foreign = self._photographer.complaint(self._camera)
        if foreign:
            tracking = replace(tracking, features=Features(), warning=foreign)
        self._stamp_ns, self._frame_id = read.stamp_ns(message.header), message.header.frame_id
        self._publish(tracking.features)
        # The servo waits for nothing of what follows.
        self._tracker.prepare()
        self._photographer.see(tracking.image)
        self._report(tracking)
        if self._renewal.is_due():
            self._renew()

    def _tell_camera(self, message: Image | CompressedImage, camera: CameraModel | None) -> None:
        """Publish the ``camera`` that the projection tells, where no other node sends one."""
        if self._info_pub is None or camera is None or self._camera not in (None, self._told):
            return
        stamp_ns = read.stamp_ns(message.header)
        if self._told is None and self.count_publishers(self._info_pub.topic_name) > 1:
            self._silent_ns = stamp_ns if self._silent_ns is None else self._silent_ns
            if seconds_between(self._silent_ns, stamp_ns) < PATIENCE_S:
                return
        if camera != self._camera and (note := cut_note(camera)):
            self.get_logger().warning(note)
        self._camera = self._told = camera
        self._info_pub.publish(write.camera_info(camera, stamp_ns, message.header.frame_id))

    def _publish(self, features: Features) -> None:
        assert self._stamp_ns is not None
        tracks = write.features(
            replace(features, goal=self._tracker.goal.id),
            self._stamp_ns,
            self._frame_id,
            repeats=self._repetition.count,
            back=self._repetition.back,
        )
        self._tracks_pub.publish(tracks)

    def _report(self, tracking: TrackingResult) -> None:
        assert self._stamp_ns is not None
        if self._settings.overlay:
            self._reports.overlay(
                tracking.image, tracking.features, self._stamp_ns, self._frame_id
            )
        if tracking.warning:
            self._warn(tracking.warning)
        self._reports.diagnose(tracking, self._stamp_ns, self._tracker.which)

    @in_every_state
    def _on_desired(self, message: Image | CompressedImage) -> None:
        try:
            image = read.gray(message)
            if self._tracker.is_desired(image):  # a latched one that comes again
                return
            self._set_desired(image)
            self._photographer.forget_camera()
        except (ValueError, TrackingError) as error:
            self.get_logger().warning(f'desired image refused: {error}')
            return
        height, width = image.shape
        self.get_logger().info(f'desired image of {width}x{height} px taken')

    def _on_capture(self) -> str:
        """Capture the photograph, and return what to say; raises ValueError if it is none."""
        image, count = self._photographer.capture()
        assert self._camera is not None  # or there were no images
        images = 'one image' if count == 1 else f'the mean of {count} images'
        if self._node_settings.capture_adds and self._tracker.has_desired:
            foreign = self._photographer.complaint(self._camera)
            if foreign:
                raise ValueError(foreign)
            self._add_desired(image, 'what the camera sees')
            kept, number = self._keep_more(), f'photograph {len(self._tracker.photographs)} of '
        else:
            self._set_desired(image)
            kept = self._photographer.keep(image, count, self._camera, self._stamp_ns or 0)
            number = ''
        self._reports.event(event_log.CAPTURED, self._stamp_ns)
        return f'this is {number}the pose to come back to, {images}{kept}'

    def _keep_more(self) -> str:
        """Keep all photographs but the first beside it; return what became of it."""
        return self._photographer.keep_more(self._tracker.photographs.images[1:])

    def _renew(self) -> None:
        """Keep the view after an arrival, where it shows other light than the photographs."""
        try:
            image, _ = self._photographer.capture()
            if self._tracker.renew(image, self._node_settings.max_photographs):
                kept, count = self._keep_more(), len(self._tracker.photographs)
                self.get_logger().info(
                    f'the view in the light of today is one of {count} photographs now{kept}'
                )
        except (ValueError, TrackingError) as error:
            self.get_logger().warning(f'the view in the light of today is not kept: {error}')

    def _on_redetect(self) -> str:
        if not self._tracker.has_desired:
            raise TrackingError('no desired image yet; take one by ~/capture_desired')
        self._tracker.redetect()
        self._reports.event(event_log.REDETECTED, self._stamp_ns)
        return 'the next image is matched anew'


if __name__ == '__main__':
    sys.exit(spin(TrackerNode))
