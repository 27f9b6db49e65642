"""Namespaces: one robot's topics are found by themselves, of several the user says which."""

from pathlib import Path
from types import SimpleNamespace

from bagmaker import decoded, kind_of, Message, TOPICS, TYPES, write_bag
import pytest

from visual_servo_epipolar.bags.reading.bag import Bag, BagTopic
from visual_servo_epipolar.bags.reading.run import read_run
from visual_servo_epipolar.bags.reading.topics import assign_roles, Namespace, namespace_of
from visual_servo_epipolar.bags.replaying.plan import plan, ReplayOverrides
from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.errors import InputError

LEFT_OUT = ('/image_raw', '/desired/image_raw')


def moved(messages: list[Message], namespace: str) -> list[Message]:
    """Return a run as a robot in ``namespace`` publishes it; diagnostics stay where all are."""
    return [
        _renamed(item, namespace)
        if item[0] == '/diagnostics'
        else (namespace + item[0], item[1], item[2])
        for item in messages
        if item[0] not in LEFT_OUT
    ]


def _renamed(message: Message, namespace: str) -> Message:
    document = decoded(message)
    for status in document.status:
        status.name = namespace + status.name
    kind = kind_of('/diagnostics')
    return '/diagnostics', message[1], bytes(TYPES.serialize_cdr(document, kind))


def bag_of(path: Path, *runs: list[Message]) -> str:
    messages = sorted((item for run in runs for item in run), key=lambda item: item[1])
    kinds = {f'/{name}{topic}': kind_of(topic) for topic in TOPICS for name in ('bot1', 'bot2')}
    return str(write_bag(path, messages, kinds=kinds))


@pytest.fixture(scope='module')
def two_robots(small_run, tmp_path_factory) -> str:
    slower = [item for item in small_run if item[0] != '/epipoles']
    path = tmp_path_factory.mktemp('bags') / 'two'
    return bag_of(path, moved(small_run, '/bot1'), moved(slower, '/bot2'))


def test_one_robot_in_a_namespace_is_taken_and_named(small_run, tmp_path, capsys) -> None:
    path = bag_of(tmp_path / 'one', moved(small_run, '/bot1'))
    assert main(['replay', path]) == 0
    shown = capsys.readouterr().out
    assert 'note: topics are those in namespace /bot1' in shown
    assert 'the same to the last bit' in shown
    assert 'bot' not in _shown_of_the_root(small_run, tmp_path, capsys)


def _shown_of_the_root(run: list[Message], folder: Path, capsys) -> str:
    assert main(['replay', bag_of(folder / 'root', moved(run, ''))]) == 0
    return capsys.readouterr().out


def test_of_two_robots_the_user_says_which(two_robots, capsys) -> None:
    assert main(['replay', two_robots]) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1
    assert 'topics of 2 robots, in /bot1 and /bot2; say which: --namespace /bot2' in error
    assert main(['replay', two_robots, '--namespace', '/bot1']) == 0
    assert 'the same to the last bit' in capsys.readouterr().out
    # Its telemetry was not recorded: only commands can be compared.
    assert main(['replay', two_robots, '--namespace', 'bot2']) == 0
    assert 'the same to the last bit' not in capsys.readouterr().out
    assert main(['replay', two_robots, '--topics', 'tracks=/bot1/tracks']) == 0


def test_diagnostics_of_the_other_robot_are_left_out(two_robots) -> None:
    with Bag(Path(two_robots)) as bag:
        namespace = namespace_of(bag, (), '/bot1')
        topics = assign_roles(bag, {}, namespace)
        run = read_run(bag, topics, namespace)
        nobody = read_run(bag, topics, Namespace('/bot3'))
    assert topics['diagnostics'].name == '/diagnostics'
    assert topics['tracks'].name == '/bot1/tracks'
    assert run.diagnoses
    assert not nobody.diagnoses


def test_a_report_takes_the_namespace_as_well(two_robots, tmp_path, capsys) -> None:
    options = ('--namespace', '/bot1', '--out', str(tmp_path / 'page'))
    assert main(['report', two_robots, *options]) == 0
    assert 'the same to the last bit' in (tmp_path / 'page/report.html').read_text('utf-8')
    assert main(['report', two_robots]) == 2
    assert '/bot1 and /bot2' in capsys.readouterr().err


def test_a_namespace_that_is_not_there_is_refused_with_those_that_are(two_robots, capsys) -> None:
    assert main(['replay', two_robots, '--namespace', '/bot3']) == 2
    assert 'no topic in namespace /bot3; it has /bot1, /bot2' in capsys.readouterr().err


def topics_of(*names: str) -> SimpleNamespace:
    kinds = {'epipoles': 'sensor_msgs/msg/JointState', 'image_raw': 'sensor_msgs/msg/Image'}
    topics = {name: BagTopic(name, kinds[name.rpartition('/')[2]], 1) for name in names}
    return SimpleNamespace(path=Path('bag'), topics=topics)


def test_the_robot_in_the_root_is_called_a_slash() -> None:
    bag = topics_of('/epipoles', '/bot2/epipoles', '/image_raw', '/bot2/image_raw')
    with pytest.raises(InputError, match='in / and /bot2'):
        namespace_of(bag)
    assert assign_roles(bag, {}, namespace_of(bag, (), '/'))['image'].name == '/image_raw'
    assert assign_roles(bag, {}, namespace_of(bag, (), '/bot2'))['image'].name == '/bot2/image_raw'


def test_what_belongs_to_no_robot_may_serve_one() -> None:
    bag = topics_of('/bot1/epipoles', '/bot2/epipoles', '/hall/image_raw', '/bot2/image_raw')
    assert assign_roles(bag, {}, namespace_of(bag, (), '/bot1'))['image'].name == '/hall/image_raw'


def test_a_whole_run_may_be_named_topic_by_topic(two_robots) -> None:
    with Bag(Path(two_robots)) as bag:
        requested = {'tracks': '/bot1/tracks', 'cmd_vel': '/bot2/cmd_vel'}
        assert namespace_of(bag, requested.values()) is None
        _, notes = plan(bag, read_run(bag, assign_roles(bag, requested | REST)), ReplayOverrides())
    assert any('recorded tracks are replayed' in note for note in notes)


REST = {
    role: f'/bot1/{name}'
    for role, name in {
        'camera_info': 'camera_info',
        'desired': 'tracker_node/desired/image_raw',
        'ground_truth': 'ground_truth',
        'tracker_settings': 'tracker_node/settings',
        'servo_settings': 'servo_node/settings',
    }.items()
}
