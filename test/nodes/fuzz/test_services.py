"""Whatever is asked of any service of any node: it is answered, and the node lives on."""

from bench import Bench
import fuzzing
from lifecycle_msgs.srv import ChangeState
import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters, SetParametersAtomically

from visual_servo_epipolar.nodes.camera_node import CameraNode
from visual_servo_epipolar.nodes.dock_node import DockNode
from visual_servo_epipolar.nodes.recorder_node import RecorderNode
from visual_servo_epipolar.nodes.route_node import RouteNode
from visual_servo_epipolar.nodes.servo_node import ServoNode
from visual_servo_epipolar.nodes.tracker_node import TrackerNode
from visual_servo_epipolar.nodes.unicycle_node import UnicycleNode

KINDS = [ServoNode, TrackerNode, RecorderNode, DockNode, RouteNode, UnicycleNode, CameraNode]
TINY = {'width': 64, 'height': 48, 'focal_length': 38.0, 'principal_u': 31.5, 'principal_v': 23.5}
ENDS = {5, 6, 7}  # transitions after which nothing is asked any more


def asked(node, kind, rng):
    """Return a request; of parameters mostly those that the node has."""
    request = fuzzing.anything(kind.Request, rng)
    if kind is ChangeState and (request.transition.id in ENDS or rng.random() < 0.7):
        request.transition.id = int(rng.choice([0, 1, 2, 3, 4, 10, 99]))
    if kind in (SetParameters, SetParametersAtomically):
        names = [name for name in node._parameters if name != 'use_sim_time']
        for item in request.parameters:
            item.name = str(rng.choice(names))
            item.value.type = int(rng.choice([*range(11), 255]))
    return request


@pytest.mark.parametrize('kind', KINDS)
def test_every_request_is_answered(bench: Bench, kind, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)  # bags may be asked for
    node = bench.start(kind, **(TINY if kind is CameraNode else {}))

    def run(count: int) -> float:
        rng = np.random.default_rng(5)
        for _ in range(count):
            for service in list(node.services):
                request = fuzzing.wired(asked(node, service.srv_type, rng))
                answer = service.callback(request, service.srv_type.Response())
                fuzzing.wired(answer)
        return fuzzing.resident_mb()

    first = run(fuzzing.COUNT // 4)
    assert run(fuzzing.COUNT // 4) - first < fuzzing.GROWTH_MB
    bench.settle()
