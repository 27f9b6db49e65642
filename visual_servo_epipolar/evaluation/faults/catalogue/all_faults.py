"""The table of all faults by name."""

from visual_servo_epipolar.evaluation.faults.catalogue import (
    base,
    calibration,
    clocks,
    images,
    nodes,
    odometry,
    orders,
    scenes,
    streams,
    tracks,
)
from visual_servo_epipolar.evaluation.faults.catalogue.fault import Fault, Faults

GROUPS = (streams, images, scenes, tracks, calibration, clocks, orders, base, nodes, odometry)
FAULTS: Faults = {'none': Fault('nothing is wrong')} | {
    name: fault for group in GROUPS for name, fault in group.FAULTS.items()
}
