"""The head of the servo: without the angles of its joints at an image, the robot stands."""

import pytest
from sensor_msgs.msg import JointState
from servo_rig import AWAY, Rig, tracks
from trajectory_msgs.msg import JointTrajectory

from visual_servo_epipolar.core.geometry.motion import Pose, STANDSTILL
from visual_servo_epipolar.core.rigs.rig import Joints
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.servo.telemetry import joints_of
from visual_servo_epipolar.messages import transforms
from visual_servo_epipolar.messages.joints import joint_states
from visual_servo_epipolar.messages.write import header
from visual_servo_epipolar.nodes.commands import Head
from visual_servo_epipolar.simulation.rigs import CameraMount

NAMES = 'pan_joint', 'tilt_joint'


class Headed(Rig):
    """A servo node whose camera sits on a head that looks ahead."""

    def __init__(self, bench, kind=JointState, **values) -> None:
        self.angles = bench.talk(JointState, 'joint_states')
        self.orders = bench.listen(kind, 'head/command')
        super().__init__(bench, rig='pan_tilt', law='smooth', **values)

    def say(self, stamp_ns: int, names: tuple[str, str] = NAMES, pan: float = 0.0) -> None:
        self.angles(joint_states(Joints(pan, 0.0), names, stamp_ns))
        self.bench.settle()

    def see_with_angles(self, **said) -> None:
        self.say(self.stamp_ns, **said)
        self.see()

    def drive(self):
        for _ in range(20):
            self.see_with_angles()
            if self.twist != STANDSTILL:
                return self
        raise AssertionError(f'the robot stands: {self.reason}')

    @property
    def trouble(self) -> str:
        return self.run.trouble


@pytest.mark.parametrize('kind', ['position', 'velocity'])
def test_it_drives_and_turns_its_head(bench, kind) -> None:
    rig = Headed(bench, head_command=kind).drive()
    assert rig.phase == 'approaching'
    assert list(rig.orders[-1].name) == list(NAMES)
    counts = len(rig.orders[-1].position), len(rig.orders[-1].velocity)
    assert counts == ((2, 0) if kind == 'position' else (0, 2))
    assert kind == 'velocity' or rig.orders[-1].position[0] != 0.0


IN_RAD = 'within -1.745 to 1.745 rad, got'


@pytest.mark.parametrize(
    ('names', 'pan', 'words'),
    [
        (('', ''), 0.0, 'no angle of pan_joint on /joint_states'),
        (('pan_joint', 'head_tilt'), 0.0, 'no angle of tilt_joint on /joint_states (it has pan_'),
        (('head_pan', 'tilt_joint'), 0.0, 'no angle of pan_joint on /joint_states (it has head_'),
        (NAMES, 45.0, f'{IN_RAD} 45: degrees, or ticks?'),
        (NAMES, 2045.0, f'{IN_RAD} 2045: degrees, or ticks?'),
    ],
)
def test_without_angles_that_can_be_used_it_does_not_begin(bench, names, pan, words) -> None:
    rig = Headed(bench)
    for _ in range(10):
        if any(names):
            rig.say(rig.stamp_ns, names, pan)
        rig.see()
    assert rig.phase == 'waiting' and not rig.orders
    assert words in rig.trouble


def test_joints_in_messages_of_their_own_are_merged(bench) -> None:
    rig = Headed(bench)
    for _ in range(8):
        for number, name in enumerate(NAMES):
            header_ = header(rig.stamp_ns, '')
            rig.angles(JointState(header=header_, name=[name], position=[0.1 * number]))
        bench.settle()
        rig.see()
    assert rig.twists()[-1] != STANDSTILL
    assert joints_of(rig.telemetry) == Joints(0.0, 0.1)


@pytest.mark.parametrize('silent', [NAMES, *((name,) for name in NAMES)])
def test_joints_that_fall_silent_stop_the_robot_until_they_speak_again(bench, silent) -> None:
    rig = Headed(bench).drive()
    for _ in range(10):
        if silent != NAMES:
            rig.say(rig.stamp_ns, ['' if name in silent else name for name in NAMES])
        rig.see()
    assert (rig.phase, rig.twist) == ('holding', STANDSTILL)
    assert f'angles of {silent[0]}' in rig.trouble and 'older than the image' in rig.trouble
    assert rig.drive().phase == 'approaching'


def test_the_other_usual_names_and_a_trajectory(bench) -> None:
    names = 'head_pan_joint', 'head_tilt_joint'
    values = {'pan_joint': names[0], 'tilt_joint': names[1], 'head_command': 'trajectory'}
    rig = Headed(bench, JointTrajectory, **values)
    for _ in range(8):
        rig.see_with_angles(names=names)
    assert rig.twists()[-1] != STANDSTILL
    assert list(rig.orders[-1].joint_names) == list(names)
    assert len(rig.orders[-1].points[0].positions) == 2


def test_angles_are_those_at_the_image(bench) -> None:
    rig = Headed(bench)
    for number, pan in enumerate((0.0, 0.05)):
        rig.say(rig.stamp_ns + (2 * number - 1) * 10_000_000, pan=pan)
    rig.tell(tracks(AWAY, rig.stamp_ns))
    assert abs(joints_of(rig.telemetry).pan - 0.025) < 1e-12


def test_a_mount_that_becomes_known_is_that_of_the_head_as_well(bench, monkeypatch) -> None:
    carriers, with_joints = [], Head.with_joints

    def spy(head, observation, carrier):
        carriers.append(carrier)
        return with_joints(head, observation, carrier)

    monkeypatch.setattr(Head, 'with_joints', spy)
    rig = Headed(bench, mount_from_tf=True)
    mount, base = CameraMount(0.6, 0.2, 0.3), Pose(0.0, 0.0, 0.0)
    place = mount.R_world_camera(base), mount.centre(base)
    rig.told(transforms.mount_transform('base_link', 'camera_optical_frame', *place))
    rig.see_with_angles()
    level = ServoSettings(rig='pan_tilt', law='smooth')
    assert carriers and level.carrier not in carriers


def test_an_encoder_that_slips_stops_the_robot_until_it_is_reset(bench) -> None:
    rig = Headed(bench).drive()
    for _ in range(10):
        rig.say(rig.stamp_ns, pan=0.4)
        rig.see()
    assert rig.twists()[-1] == STANDSTILL and 'leap by 0.40 rad' in rig.trouble
    assert bench.call('servo_node/reset').success
    rig.drive()
