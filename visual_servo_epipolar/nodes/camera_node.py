"""A simulated camera: ground truth in, images of a room out."""

from collections import deque
import sys
from typing import Any

import cv2
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
import numpy as np
from sensor_msgs.msg import CameraInfo, Image, JointState

from visual_servo_epipolar.core.arrays import Image as Pixels
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.rigs.rig import AT_REST
from visual_servo_epipolar.core.settings import selected
from visual_servo_epipolar.core.stamps import period_ns
from visual_servo_epipolar.messages import read, transforms, write
from visual_servo_epipolar.messages.joints import COMMAND_TYPES, joint_states, read_head_command
from visual_servo_epipolar.nodes import parameters, qos
from visual_servo_epipolar.nodes.frames import TransformBroadcaster
from visual_servo_epipolar.nodes.managed import ParameterNode
from visual_servo_epipolar.nodes.reports import Complaints
from visual_servo_epipolar.nodes.startup.run import spin
from visual_servo_epipolar.nodes.startup.settings import CameraRig
from visual_servo_epipolar.simulation.bases import Nod
from visual_servo_epipolar.simulation.camera_simulator import CameraSimulator
from visual_servo_epipolar.simulation.cameras import (
    CameraSettings,
    head_settings,
    HeadSettings,
    SIMULATED_RIGS,
    SimulatedHead,
)
from visual_servo_epipolar.simulation.disturbances import DisturbanceSettings
from visual_servo_epipolar.simulation.light import LightSettings
from visual_servo_epipolar.simulation.sensor import BodyState, CameraMotion, PoseHistory


class CameraNode(ParameterNode):
    """Hosts a ``CameraSimulator``: an image a frame of ground truth, in any kind of time."""

    sends_images = True

    def __init__(self, **options: Any) -> None:
        super().__init__('camera_node', **options)
        self._warn = Complaints(self)
        self._settings = parameters.declare(self, CameraSettings)
        self._head_settings = parameters.declare(self, HeadSettings)
        self._rig = parameters.declare(self, CameraRig)
        self._disturbances = parameters.declare(self, DisturbanceSettings)
        self._light = parameters.declare(self, LightSettings)
        parameters.finish(self, options)
        parameters.watch(self, '_settings', self._use)
        parameters.watch(self, '_head_settings', self._use_head)
        parameters.watch(
            self, '_disturbances', lambda: self._simulator.disturb(self._disturbances)
        )
        parameters.watch(self, '_light', lambda: self._simulator.relight(self._light))
        self._info = self._settings.nominal_camera
        self._joint_names = self._rig.pan_joint, self._rig.tilt_joint
        self._simulator = CameraSimulator(self._on_rig(), self._disturbances, self._light)
        self._frame, self._history = 0, PoseHistory()
        self._pending: deque[tuple[int, int]] = deque()  # frames: when received, when exposed
        self._last_ns: int | None = None
        self._image_pub = self.create_publisher(Image, 'image_raw', qos.STREAM)
        self._info_pub = self.create_publisher(CameraInfo, 'camera_info', qos.STREAM)
        self._desired_pub = self.create_publisher(Image, 'desired/image_raw', qos.LATCHED)
        self._head: SimulatedHead | None = None
        self._has_head = head_settings(self._simulator.settings) is not None
        if self._has_head:
            self._joints_pub = self.create_publisher(JointState, 'joint_states', qos.STREAM)
            # Before the truth: where both have come, the command is taken first.
            kind = COMMAND_TYPES[self._rig.head_command]
            self.create_subscription(kind, 'head/command', self._on_head_command, qos.COMMAND)
        self.create_subscription(Odometry, 'ground_truth', self._on_truth, qos.STREAM)
        self._tf = TransformBroadcaster(self, static=True)
        self._tf.send([self._mount_transform()])
        self._desired_pub.publish(self._message(self._simulator.photograph(), 0))

    def _mount_transform(self) -> TransformStamped:
        """Return where the camera sits on the base; the floor's jitter is unknown."""
        mount, base = self._settings.mount, Pose(0.0, 0.0, 0.0)
        return transforms.mount_transform(
            self._rig.base_frame,
            self._rig.camera_frame,
            mount.R_world_camera(base),
            mount.centre(base),
        )

    def _on_rig(self) -> CameraSettings:
        """Return the settings of the camera on its rig."""
        return selected(SIMULATED_RIGS[self._rig.rig], self._settings, self._head_settings)

    def _use(self) -> None:
        self._info = self._settings.nominal_camera
        self._simulator.settings = self._on_rig()

    def _use_head(self) -> None:
        self._simulator.settings = self._on_rig()
        if self._head is not None:
            self._head.settings = self._head_settings

    def _on_head_command(self, message: Any) -> None:
        try:
            command = read_head_command(message, self._joint_names)
        except ValueError as error:
            self._warn(str(error))
            return
        if self._head is not None:
            self._head.command(command)

    def _turn_head(self, stamp_ns: int) -> None:
        """Let the head, if there is one, move until the time of a ground truth, and say where."""
        if not self._has_head:
            return
        if self._head is None or stamp_ns < self._head.now_ns:  # time began, or begins anew
            seed = self._settings.seed
            self._head = SimulatedHead(self._head_settings, seed=seed, now_ns=stamp_ns)
        self._head.advance(stamp_ns)
        self._joints_pub.publish(joint_states(self._head.read(), self._joint_names, stamp_ns))

    def _on_truth(self, message: Odometry) -> None:
        try:
            stamp_ns, nod = read.stamp_ns(message.header), Nod(*read.pitch(message))
            body = BodyState(read.pose(message), read.twist(message.twist), nod)
        except ValueError as error:
            self._warn(str(error))
            return
        self._turn_head(stamp_ns)
        self._history.add(stamp_ns, body)
        if self._pending and stamp_ns < self._pending[-1][1]:  # time runs backwards
            self._pending.clear()
        if self._is_due(stamp_ns):
            number = self._frame + len(self._pending)
            late_ns = self._settings.receipt.delay_ns(number)
            self._pending.append((stamp_ns + late_ns, stamp_ns))
        while self._pending and self._pending[0][0] <= stamp_ns:
            self._take(self._pending.popleft()[1], stamp_ns)

    def _take(self, exposed_ns: int, stamp_ns: int) -> None:
        """Publish the image that was exposed then, and is received now."""
        pose, twist, nod = self._history.at(exposed_ns)
        joints = AT_REST if self._head is None else self._head.joints
        image = self._simulator.capture(pose, self._frame, CameraMotion(twist, nod, joints))
        self._frame += 1
        info = write.camera_info(self._info, stamp_ns, self._rig.camera_frame)
        self._info_pub.publish(info)
        self._image_pub.publish(self._message(image, stamp_ns))

    def _is_due(self, stamp_ns: int) -> bool:
        """Return whether a frame has passed; time running backwards starts anew."""
        period, last = period_ns(self._settings.frame_rate), self._last_ns
        if last is not None and last <= stamp_ns < last + period:
            return False
        if last is not None and stamp_ns < last + 2 * period:
            self._last_ns = last + period
        else:
            self._last_ns = stamp_ns
        return True

    def _message(self, image: Pixels, stamp_ns: int) -> Image:
        encoding = self._settings.encoding
        if encoding == 'bgr8':
            image = np.asarray(cv2.merge([image] * 3), np.uint8)
        return write.image(image, encoding, stamp_ns, self._rig.camera_frame)


if __name__ == '__main__':
    sys.exit(spin(CameraNode))
