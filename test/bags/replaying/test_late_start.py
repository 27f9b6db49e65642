"""A recording that began after the nodes: replay says what it cannot know."""

from bagmaker import decoded, kind_of, Message, TYPES, write_bag
import pytest

from visual_servo_epipolar.bags.reading.bag import Bag
from visual_servo_epipolar.bags.reading.run import read_run
from visual_servo_epipolar.bags.reading.topics import assign_roles
from visual_servo_epipolar.bags.replaying.plan import plan, ReplayOverrides, SERVO, TRACKER
from visual_servo_epipolar.commands.main import main

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


def notes_on(path, **overrides: object) -> list[str]:
    with Bag(path) as bag:
        return plan(bag, read_run(bag, assign_roles(bag, {})), ReplayOverrides(**overrides))[1]


def test_a_recording_from_the_beginning_needs_no_word(small_run, tmp_path) -> None:
    path = write_bag(tmp_path / 'whole', small_run)
    assert notes_on(path) == notes_on(path, from_tracks=True) == []


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


@pytest.mark.parametrize('frames', [1, 10, 45])
def test_a_servo_at_work_is_known_by_its_first_step(small_run, tmp_path, frames) -> None:
    path = write_bag(tmp_path / 'late', begun_late(small_run, frames, BY_SERVO))
    assert notes_on(path) == notes_on(path, from_tracks=True) == [SERVO]


def test_a_servo_that_fails_when_recording_begins_is_known_by_its_phase(
    small_run, tmp_path
) -> None:
    messages = [item for item in small_run if item[0] != '/tracks']
    path = write_bag(tmp_path / 'bag', [_failing(item) for item in messages])
    assert SERVO in notes_on(path)


def _failing(message: Message) -> Message:
    topic, log_ns, raw = message
    if topic == '/diagnostics':
        document = decoded(message)
        next(pair for pair in document.status[0].values if pair.key == 'phase').value = 'failed'
        raw = bytes(TYPES.serialize_cdr(document, kind_of(topic)))
    return topic, log_ns, raw
