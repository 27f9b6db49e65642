"""A tracker node on a bench, fed with images one by one; what it publishes of each."""

from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from visual_servo_epipolar.messages import read, write
from visual_servo_epipolar.nodes import qos
from visual_servo_epipolar.nodes.tracker_node import TrackerNode

STAMP_NS = 5_000_000_007


class Rig:
    """A running tracker node with a camera in front of it."""

    def __init__(self, bench, simulator, **values) -> None:
        self.bench, self.simulator, self.camera = bench, simulator, simulator.camera
        self.clouds = bench.listen(PointCloud2, 'tracks')
        self.send = bench.talk(Image, 'image_raw')
        self.calibrate = bench.talk(CameraInfo, 'camera_info')
        self.teach = bench.talk(Image, 'desired/image_raw', qos.LATCHED)
        self.node = bench.start(TrackerNode, **values)

    def calibrated(self):
        self.calibrate(write.camera_info(self.camera, 0, 'camera'))
        self.bench.settle()
        return self

    def taught(self, photograph):
        self.teach(message(photograph))
        self.bench.until(lambda: self.node.ready, 'the photograph to arrive')
        return self

    def track(self, image, stamp_ns=STAMP_NS):
        """Send an image and return the features of its cloud."""
        count = len(self.clouds)
        self.send(message(image, stamp_ns))
        self.bench.until(lambda: len(self.clouds) > count, 'tracks')
        return read.features(self.clouds[-1])


def message(image, stamp_ns=STAMP_NS):
    return write.image(image, 'mono8', stamp_ns, 'camera')
