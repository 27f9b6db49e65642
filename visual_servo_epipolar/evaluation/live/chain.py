"""Tracker and servo as processes: this process is their camera, and hears their answers."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import cycle, islice
from pathlib import Path
import time
from typing import Any

from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.cameras.model import CameraModel
from visual_servo_epipolar.core.errors import VisualServoError
from visual_servo_epipolar.core.geometry.motion import STANDSTILL, Twist
from visual_servo_epipolar.core.stamps import period_ns
from visual_servo_epipolar.evaluation.live import echo
from visual_servo_epipolar.evaluation.live.processes import (
    arguments,
    Listener,
    start_nodes,
    START_S,
)
from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import qos

RELIABLE = arguments(camera_reliability='reliable')
# A twist with a stamp is known to answer the image of that stamp.
TRACKER_AND_SERVO = {
    'tracker_node': RELIABLE,
    'servo_node': (*RELIABLE, *arguments(autostart='true', enable_stamped_cmd_vel='true')),
}
ECHO = {echo.__name__: ()}
FRAME_ID = 'camera_optical_frame'
START = (1.0, -3.5, 8.0)  # x, y [m], heading error [deg]; it takes half a minute from there
WARM_UP_S, SETTLE_S = 1.0, 0.5
COUNTER_BYTES = 4


@dataclass(slots=True)
class Answers:
    """A stretch of time: when images were sent, and the latencies of the answers."""

    sent: dict[int, float] = field(default_factory=dict)  # by stamp [ns], on the steady clock [s]
    latencies: list[float] = field(default_factory=list)  # image sent to twist received [s]
    twists: list[Twist] = field(default_factory=list)
    answered: list[int] = field(default_factory=list)  # stamps of the images, as answers came [ns]

    def __iadd__(self, other: 'Answers') -> 'Answers':
        self.sent |= other.sent
        self.latencies += other.latencies
        self.twists += other.twists
        self.answered += other.answered
        return self

    def took(self, message: TwistStamped) -> None:
        """Take the answer to an image."""
        stamp_ns = read.stamp_ns(message.header)
        sent = self.sent.get(stamp_ns)
        if sent is not None:
            self.answered.append(stamp_ns)
            self.latencies.append(time.monotonic() - sent)
            self.twists.append(read.twist(message))

    @property
    def moving(self) -> int:
        """How many twists are not zero."""
        return sum(twist != STANDSTILL for twist in self.twists)

    @property
    def numbers(self) -> list[int]:
        """Which of the images were answered, as answers came: 0 is the first that was sent."""
        order = {stamp_ns: number for number, stamp_ns in enumerate(self.sent)}
        return [order[stamp_ns] for stamp_ns in self.answered]


class PlayedCamera(Listener):
    """
    Nodes in processes of their own; this process is their camera, and hears their twists.

    The camera shows the ``images`` over and over. ``nodes`` are names with their arguments; they
    run in ``folder``, where bags go.
    """

    def __init__(
        self,
        stack: ExitStack,
        camera: CameraModel,
        images: Sequence[Pixels],
        folder: Path,
        nodes: Mapping[str, Sequence[str]],
    ) -> None:
        super().__init__(stack, 'bench_camera')
        self.drive = Answers()
        for topic in ('cmd_vel', echo.ANSWERS):
            self.node.create_subscription(TwistStamped, topic, self._on_answer, qos.COMMAND)
        self._camera, self._images, self._count = camera, cycle(images), 0
        self._image_pub = self.node.create_publisher(Image, 'image_raw', qos.STREAM)
        self._echo_pub = self.node.create_publisher(Image, echo.IMAGES, qos.STREAM)
        self._info_pub = self.node.create_publisher(CameraInfo, 'camera_info', qos.STREAM)
        self._desired_pub = self.node.create_publisher(Image, 'desired/image_raw', qos.LATCHED)
        self.processes = start_nodes(stack, nodes, folder)

    def call(self, service: str) -> str:
        """Call a service of std_srvs/Trigger, and return what it says."""
        client = self.node.create_client(Trigger, service)
        try:
            if not client.wait_for_service(START_S):
                raise VisualServoError(f'no node served {service} within {START_S:g} s')
            future: Any = client.call_async(Trigger.Request())
            self._executor.spin_until_future_complete(future, START_S)
            answer = future.result()
        finally:
            self.node.destroy_client(client)
        if answer is None or not answer.success:
            raise VisualServoError(f'{service} failed: {answer and answer.message}')
        return str(answer.message)

    def show_goal(self, photograph: Pixels) -> None:
        """Publish the photograph, and wait until the servo answers to images."""
        self._desired_pub.publish(write.image(photograph, 'mono8', 0, FRAME_ID))
        self.wait(
            lambda: bool(self.show(1.0, 10.0).latencies), 'the servo has answered to no image'
        )
        self.show(WARM_UP_S, 10.0)

    def show(self, seconds: float, rate: float, *, to_echo: bool = False) -> Answers:
        """Publish images for ``seconds`` [s] at ``rate`` [Hz], and return the answers."""
        images = list(islice(self._images, round(seconds * rate)))
        return self.show_each(images, rate, to_echo=to_echo)

    def show_each(
        self, images: Sequence[Pixels], rate: float, *, to_echo: bool = False
    ) -> Answers:
        """Publish these images at ``rate`` [Hz], stamped as they are due; return the answers."""
        publisher = self._echo_pub if to_echo else self._image_pub
        self.drive = drive = Answers()
        begin_ns, begin = self.node.get_clock().now().nanoseconds, time.monotonic()
        for number, image in enumerate(images):
            self._spin_until(begin + number / rate)
            self._publish(publisher, image, begin_ns + number * period_ns(rate))
        self.spin_for(SETTLE_S)
        return drive

    def wait_for_listeners(self, count: int, *, to_echo: bool = False) -> None:
        """Wait until so many subscribe to images."""
        publisher = self._echo_pub if to_echo else self._image_pub
        self.wait(
            lambda: publisher.get_subscription_count() >= count,
            f'images have found no {count} listeners',
        )

    def _publish(self, publisher: Any, image: Pixels, stamp_ns: int) -> None:
        image = image.copy()
        self._count += 1
        # No camera takes the very same image twice, and the servo does not drive by one.
        image[0, :COUNTER_BYTES] = list(self._count.to_bytes(COUNTER_BYTES, 'big'))
        message = write.image(image, 'mono8', stamp_ns, FRAME_ID)
        if publisher is self._image_pub:
            self._info_pub.publish(write.camera_info(self._camera, stamp_ns, FRAME_ID))
        self.drive.sent[stamp_ns] = time.monotonic()
        publisher.publish(message)

    def _on_answer(self, message: TwistStamped) -> None:
        self.drive.took(message)
