"""Replay: the same to the last bit with the same parameters, and told apart with others."""

from dataclasses import replace
import json
from pathlib import Path
import struct

from bagmaker import (
    decoded,
    drive,
    Message,
    published,
    replayed,
    small_scenario,
    twists,
    write_bag,
)
import pytest
from rclpy.serialization import serialize_message

from visual_servo_epipolar import __version__
from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.run import read_run, Recording
from visual_servo_epipolar.bags.reading.topics import assign_roles
from visual_servo_epipolar.bags.replaying.comparison import compare
from visual_servo_epipolar.bags.replaying.plan import (
    Moment,
    plan,
    ReplayOverrides,
    SERVO,
    TRACKER,
)
from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.servo.telemetry import ODOMETRY, odometry_of
from visual_servo_epipolar.messages import read, write

DESIRED = '/tracker_node/desired/image_raw'
STEP_NS = 90_909_091  # of the recorded run


def without(messages: list[Message], *topics: str) -> list[Message]:
    return [item for item in messages if item[0] not in topics]


def notes_on(path: Path, **overrides: object) -> list[str]:
    """Return the notes on how a bag would be replayed."""
    with Bag(path) as bag:
        return plan(bag, read_run(bag, assign_roles(bag, {})), ReplayOverrides(**overrides))[1]


def retold(run: list[Message], path: Path, *changes: tuple[str, str]) -> Path:
    """Write a bag of a run whose tracker has other settings, by words of their text."""
    messages = []
    for item in run:
        if item[0] == '/tracker_node/settings':
            text = decoded(item).data
            for old, new in changes:
                text = text.replace(old, new)
            item = (*item[:2], serialize_message(write.text(text)))
        messages.append(item)
    return write_bag(path, messages)


@pytest.fixture(scope='session')
def bag(small_run, tmp_path_factory) -> Path:
    return write_bag(tmp_path_factory.mktemp('bags') / 'small', small_run)


@pytest.mark.parametrize('from_tracks', [False, True])
def test_the_same_parameters_give_the_same_commands_to_a_bit(bag, small_run, from_tracks) -> None:
    _, steps, comparison = replayed(bag, from_tracks=from_tracks)
    again, recorded = (
        [struct.pack('<2d', *twist) for twist in each]
        for each in (twists(steps), published(small_run))
    )
    assert again == recorded
    assert len(steps) >= 50
    assert comparison.equal
    assert comparison.compared == len(steps)
    assert {'phase', 'epipole_current_px', 'linear_m_s'} <= comparison.differences.keys()
    assert all(item.largest == 0.0 for item in comparison.differences.values())


def test_other_settings_of_the_tracker_part_as_well(bag) -> None:
    _, _, comparison = replayed(bag, changes={'tracker': {'max_features': 30, 'min_features': 20}})
    assert comparison.divergence is not None
    assert 'features' in comparison.divergence.values


def test_a_recorded_value_that_no_robot_has_is_a_difference_like_any(bag) -> None:
    run, steps, _ = replayed(bag)
    broken = {key: {**values, 'roll_rad': -3e200} for key, values in run.telemetry.items()}
    comparison = compare(replace(run, telemetry=broken), steps, 0.0)
    assert not comparison.equal
    difference = comparison.differences['roll_rad']
    assert difference.largest == 3e200
    assert difference.rms == pytest.approx(3e200)


def test_another_phase_is_never_forgiven(bag) -> None:
    changes = {'servo': {'displacement_tolerance': 0.3}}
    _, _, comparison = replayed(bag, from_tracks=True, changes=changes, tolerance=1e9)
    assert comparison.divergence is not None
    assert comparison.divergence.values.keys() == {'phase'}


def test_an_image_that_the_tracker_dropped_is_not_replayed(small_run, tmp_path) -> None:
    dropped_ns = 20 * STEP_NS

    def is_of_it(item: Message) -> bool:
        of_step = item[0] in ('/tracks', '/epipoles', '/diagnostics')
        return of_step and read.stamp_ns(decoded(item).header) == dropped_ns

    path = write_bag(tmp_path / 'dropped', [item for item in small_run if not is_of_it(item)])
    assert dropped_ns not in {step.key[0] for step in replayed(path).steps}


def test_a_recorded_step_without_its_image_is_missed(small_run, tmp_path) -> None:
    images = [item for item in small_run if item[0] == '/image_raw']
    path = write_bag(tmp_path / 'lost', [item for item in small_run if item is not images[-5]])
    _, _, comparison = replayed(path)
    assert comparison.missing == 1
    assert not comparison.equal


def test_tracks_alone_are_replayed_by_themselves(small_run, tmp_path) -> None:
    images = '/image_raw', '/desired/image_raw', DESIRED
    path = write_bag(tmp_path / 'tracks', without(small_run, *images))
    assert any('recorded tracks are replayed' in note for note in notes_on(path))
    assert replayed(path).comparison.equal


def test_a_network_that_is_gone_keeps_no_tracks_from_being_replayed(small_run, tmp_path) -> None:
    gone = ('matcher: sift', 'matcher: onnx'), ("matcher_model: ''", 'matcher_model: /gone.onnx')
    path = retold(small_run, tmp_path / 'gone', *gone)
    assert replayed(path, from_tracks=True).comparison.equal
    with pytest.raises(InputError, match=r'recorded tracker: matcher_model .*/gone.onnx'):
        replayed(path)
    sift = {'tracker': {'matcher': 'sift', 'matcher_model': ''}}
    assert replayed(path, changes=sift).comparison.equal


def test_the_photograph_may_come_from_the_simulator_alone(small_run, tmp_path) -> None:
    path = write_bag(tmp_path / 'desired', without(small_run, DESIRED))
    assert replayed(path).comparison.equal


def test_the_photograph_may_be_an_image_of_the_bag(bag) -> None:
    _, steps, _ = replayed(bag, desired=Moment(0, since_first=True))
    assert steps[0].telemetry['feature_error_px'] < 0.1
    stamp_ns = steps[10].key[0]
    _, steps, _ = replayed(bag, desired=Moment(stamp_ns + 1_000))
    assert steps[10].telemetry['feature_error_px'] < 0.1


def test_a_bag_of_another_version_is_noted(small_run, tmp_path) -> None:
    texts = [
        (topic, log_ns, raw.replace(f'_epipolar: {__version__}'.encode(), b'_epipolar: 9.0.0'))
        for topic, log_ns, raw in small_run
    ]
    path = write_bag(tmp_path / 'later', texts)
    assert notes_on(path) == [f'recorded with version 9.0.0, replayed with {__version__}']


@pytest.mark.parametrize('value', [0, 20])
def test_a_setting_that_is_gone_is_noted_where_it_was_on(small_run, tmp_path, value) -> None:
    more = 'matcher: sift', f'auxiliary_features: {value}\n    matcher: sift'
    path = retold(small_run, tmp_path / 'gone', more)
    expected = 'recorded with auxiliary_features 20: this version replays without it'
    assert notes_on(path) == ([expected] if value else [])


BY_TRACKER = ('/image_raw', '/camera_info', '/tracks')
BY_SERVO = ('/epipoles', '/diagnostics', '/cmd_vel')


def begun_late(
    run: list[Message], frames: int, topics: tuple[str, ...] = (*BY_TRACKER, *BY_SERVO)
) -> list[Message]:
    """Return a run without the first ``frames`` messages of each of ``topics``."""
    kept, counts = [], dict.fromkeys(topics, 0)
    for item in run:
        if item[0] in counts and counts[item[0]] < frames:
            counts[item[0]] += 1
        else:
            kept.append(item)
    return kept


def test_a_recording_from_the_beginning_needs_no_word(bag) -> None:
    assert notes_on(bag) == notes_on(bag, from_tracks=True) == []


def test_a_recording_that_began_after_both_says_so(small_run, tmp_path, capsys) -> None:
    path = write_bag(tmp_path / 'late', begun_late(small_run, 25))
    assert notes_on(path) == [TRACKER, SERVO]
    assert notes_on(path, from_tracks=True) == [SERVO]
    main(['replay', str(path)])
    shown = capsys.readouterr().out
    assert 'the recording began after the tracker' in shown
    assert '--tracks' in shown
    assert main(['report', str(path), '--out', str(tmp_path)]) == 0
    assert 'the recording began after the tracker' in (tmp_path / 'report.html').read_text('utf-8')


def test_a_servo_at_work_is_known_by_its_phase(small_run, tmp_path) -> None:
    path = write_bag(tmp_path / 'late', begun_late(small_run, 45, BY_SERVO))
    assert notes_on(path) == notes_on(path, from_tracks=True) == [SERVO]


def without_odometry(run: Recording) -> Recording:
    """Return a recording as an earlier version wrote it, without odometry in the telemetry."""
    telemetry = {
        key: {name: value for name, value in values.items() if name not in ODOMETRY}
        for key, values in run.telemetry.items()
    }
    return replace(run, telemetry=telemetry)


@pytest.fixture(scope='module')
def reckoned(tmp_path_factory) -> Path:
    """Return the bag of a run by odometry."""
    scenario = small_scenario(4.0, odometry=True)
    said = drive(scenario, scenario.loop((0.3, -2.2, 0.0), 0))
    return write_bag(tmp_path_factory.mktemp('bags') / 'reckoned', said)


@pytest.mark.parametrize('from_tracks', [False, True])
def test_a_run_by_odometry_is_replayed_to_the_last_bit(reckoned, from_tracks) -> None:
    _, steps, comparison = replayed(reckoned, from_tracks=from_tracks)
    assert comparison.equal
    assert comparison.differences[ODOMETRY[0]].compared == len(steps)
    poses = [odometry_of(step.telemetry) for step in steps]
    assert None not in poses
    assert poses[-1] != poses[0]


@pytest.mark.parametrize(
    'values',
    [{'known': without_odometry}, {'changes': {'servo': {'odometry': False}}}],
    ids=['not recorded', 'not wanted'],
)
def test_odometry_that_is_not_recorded_or_not_wanted_is_not_used(reckoned, values) -> None:
    steps = replayed(reckoned, from_tracks=True, **values).steps
    assert {odometry_of(step.telemetry) for step in steps} == {None}


def test_a_bag_of_before_odometry_is_replayed_as_it_was(bag) -> None:
    assert replayed(bag, from_tracks=True, known=without_odometry).comparison.equal


def test_the_end_of_the_run_is_not_that_of_the_bag(small_run, tmp_path, capsys) -> None:
    bag = str(write_bag(tmp_path / 'bag', small_run))
    early = ('--tracks', '--set', 'servo.run_timeout=2')
    assert main(['replay', bag, *early, '--json', '-']) == 1
    result = json.loads(capsys.readouterr().out)
    (failed,) = (item for item in result['phases'] if item['name'] == 'failed')
    assert failed['start_s'] == pytest.approx(2.0, abs=0.2)
    assert result['duration_s'] == failed['end_s'] == pytest.approx(2.5, abs=0.2)
    assert result['recorded_s'] == pytest.approx(4.9, abs=0.2)
    main(['replay', bag, *early])
    assert f'failed; the recording goes on to {result["recorded_s"]:.1f} s' in (
        capsys.readouterr().out
    )
    assert main(['report', bag, *early, '--out', str(tmp_path)]) == 0
    page = (tmp_path / 'report.html').read_text('utf-8')
    assert f'Failed after {result["duration_s"]:.1f} s' in page
    assert 'duration of the recording' in page
