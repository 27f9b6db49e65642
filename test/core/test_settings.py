"""Settings: a value that exists is within its ranges, and refusals say what is allowed."""

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from importlib.metadata import EntryPoint
import math
import re
from typing import Any, ClassVar

import pytest

from visual_servo_epipolar.core import registry
from visual_servo_epipolar.core.estimate.settings import ControlSettings
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.core.settings import hint, range_of, setting, Settings, updated
from visual_servo_epipolar.core.tracking.settings import TrackerSettings
from visual_servo_epipolar.core.twoview.settings import PerceptionSettings


@dataclass(frozen=True, kw_only=True)
class Sample(Settings):
    gain: float = setting(0.5, 'Gain of the sample [1/s]', low=0.0, high=2.0)
    count: int = setting(3, 'Number of samples', low=1, high=9)
    mode: str = setting('slow', 'How fast', choices=('slow', 'fast'))
    enabled: bool = setting(True, 'Whether at all', read_only=True)
    offset: tuple[float, ...] = setting((0.0, 1.0), 'Offset [m]', low=-5.0, high=5.0)
    names: tuple[str, ...] = setting(('a',), 'Names')
    files: str = setting('', 'Files', path=True)


def test_a_home_folder_is_written_out_in_paths(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('HOME', '/home/user')
    assert Sample(files='~/a~b.png').files == '/home/user/a~b.png'
    assert Sample(names=('~/topic',)).names == ('~/topic',)


@pytest.mark.parametrize(
    ('name', 'value', 'message'),
    [
        ('gain', 2.1, r'gain must lie in \[0, 2\], got 2.1; it is: Gain of the sample \[1/s\]'),
        ('gain', -1e-9, r'gain must lie in \[0, 2\]'),
        ('gain', math.nan, r'gain must lie in \[0, 2\], got nan'),
        ('gain', math.inf, 'gain must lie in .* got inf'),
        ('gain', 'high', r"gain must be float, got 'high' \(str\); Gain of the sample"),
        ('gain', None, 'gain must be float, got None'),
        ('gain', True, r'gain must be float, got True \(bool\)'),
        pytest.param('gain', 10**400, 'gain must lie in', id='gain-huge'),
        ('count', 0, r'count must lie in \[1, 9\], got 0'),
        ('count', 3.0, r'count must be int, got 3.0 \(float\)'),
        ('count', True, r'count must be int, got True \(bool\)'),
        pytest.param('count', 10**400, 'count must lie in', id='count-huge'),
        ('mode', 'quick', "mode must be one of slow, fast, got 'quick'"),
        ('mode', 1, 'mode must be str, got 1'),
        ('enabled', 1, r'enabled must be bool, got 1 \(int\)'),
        ('offset', (0.0, 'a'), 'offset must be a list of numbers'),
        ('offset', [0.0, 6.0], r'offset must lie in \[-5, 5\], got 6'),
        ('offset', 1.0, 'offset must be tuple, got 1.0'),
        ('names', ['a', 1], r"names must be a list of words, got \('a', 1\)"),
        ('names', 'a', "names must be tuple, got 'a'"),
    ],
)
def test_a_bad_value_is_refused_by_name(name: str, value: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Sample(**{name: value})


@pytest.mark.parametrize(
    ('name', 'value', 'kept'),
    [
        ('gain', 0.0, 0.0),
        ('gain', 2.0, 2.0),
        ('gain', 1, 1.0),
        ('count', 9, 9),
        ('mode', 'fast', 'fast'),
        ('offset', [1, -5], (1.0, -5.0)),
        ('names', ['b', 'c'], ('b', 'c')),
        ('names', [], ()),
    ],
)
def test_the_ends_of_a_range_are_allowed_and_types_settled(name, value, kept) -> None:
    found = getattr(Sample(**{name: value}), name)
    assert found == kept
    assert type(found) is type(kept)


@pytest.mark.parametrize(
    ('word', 'meant'),
    [
        ('max_linaer', 'max_linear'),
        ('linear', 'max_linear'),  # a part of it
        ('Max-Linear', 'max_linear'),
        ('turn', 'turn_gain'),
        ('turn_speed', 'turn_gain'),  # the same beginning
        ('law_name', 'law'),
        ('kk1', 'k1'),
        ('k3', 'k2 or k1'),  # of two letters one is wrong
        ('K1', 'k1'),
        ('kt', 'k_t'),
        ('k', 'k2 or k1'),
    ],
)
def test_a_misspelt_name_is_answered_by_the_one_that_is_meant(word: str, meant: str) -> None:
    known = ['k1', 'k2', 'k_t', 'turn_gain', 'max_linear', 'law']
    assert hint([word], known) == f'did you mean {meant}?'


@pytest.mark.parametrize(
    ('limits', 'words'),
    [
        ({'low': 0.0}, 'x must be at least 0, got nan; it is: X'),
        ({'high': 2.0}, 'x must be at most 2, got nan; it is: X'),
        ({}, 'x must be finite, got nan; it is: X'),
        ({'low': 0.0, 'high': 2.0}, 'x must lie in [0, 2], got nan; it is: X'),
    ],
)
def test_a_range_without_an_end_is_said_in_words(limits: dict[str, float], words: str) -> None:
    @dataclass(frozen=True, kw_only=True)
    class Open(Settings):
        x: float = setting(1.0, 'X', **limits)

    with pytest.raises(ValueError, match=f'^{re.escape(words)}$'):
        Open(x=math.nan)


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'xyz': 1.0, 3: 2}, ' has no setting 3, xyz; it knows gain, count'),
        ({'gian': 1.0}, r' has no setting gian; did you mean gain\?$'),
        ({'gain': 9.0}, ': gain must lie in'),
        *((values, ' must map names to values, got') for values in ([1, 2], 'gain', 3, None)),
    ],
)
def test_a_refusal_says_where_the_value_stood_and_what_is_meant(values, message: str) -> None:
    with pytest.raises(ValueError, match=f'^file.yaml{message}'):
        updated(Sample(), values, 'file.yaml')


def test_an_update_keeps_the_rest() -> None:
    before = Sample(count=5, mode='fast')
    assert updated(before, {'gain': 1}, 'test') == replace(before, gain=1.0)


@pytest.mark.parametrize(
    ('kind', 'changes', 'message'),
    [
        (ServoSettings, {'latch_engage': 0.02, 'latch_release': 0.01}, 'latch_engage must not'),
        (ServoSettings, {'min_displacement': 0.4, 'max_displacement': 0.3}, 'got 0.4 and 0.3'),
        (ServoSettings, {'dead_band_linear': 0.5, 'max_linear': 0.4}, 'dead bands must not'),
        (ServoSettings, {'dead_band_angular': 0.5, 'max_angular': 0.4}, 'got 0 m/s and 0.5 rad/s'),
        (TrackerSettings, {'min_features': 41, 'max_features': 40}, 'min_features must not'),
        (PerceptionSettings, {'estimator': 'linear_9pt'}, "^estimator must be one of .*'linear_9"),
    ],
)
def test_settings_that_contradict_each_other_or_name_nothing_are_refused(
    kind, changes, message
) -> None:
    with pytest.raises(ValueError, match=message):
        kind(**changes)


@pytest.mark.parametrize('kind', [ServoSettings, TrackerSettings])
def test_every_setting_is_described_and_lies_in_its_own_range(kind: type[Settings]) -> None:
    for item in fields(kind):
        limits = range_of(item)
        assert limits.text, item.name
        if type(item.default) in (int, float):
            assert limits.low is not None, item.name
            assert limits.high is not None, item.name
            assert limits.low <= item.default <= limits.high, item.name


def test_what_is_fixed_at_the_start_is_read_only() -> None:
    read_only = {item.name for item in fields(ServoSettings) if range_of(item).read_only}
    assert 'estimator' in read_only
    assert not read_only & {'law', 'k1', 'k2', 'k_t', 'max_linear', 'max_angular'}


@pytest.mark.parametrize('names', [('room', 'spiral_ratio'), ('spiral_ratio', 'room')])
def test_a_setting_is_not_given_by_its_old_and_its_new_name_at_once(names) -> None:
    message = f'^a bag must give spiral_ratio once, got {names[0]} and {names[1]}, .*; keep spiral'
    with pytest.raises(ValueError, match=message):
        updated(ServoSettings(), dict.fromkeys(names, 0.5), 'a bag')


@dataclass(frozen=True, kw_only=True)
class Renamed(Settings):
    RENAMED: ClassVar[Mapping[str, str]] = {'amount': 'number', 'pace': 'speed'}
    number: int = setting(1, 'Number', low=0, high=9)
    speed: float = setting(1.0, 'Speed [m/s]', low=0.0, high=9.0)


@dataclass(frozen=True, kw_only=True)
class Both(Renamed, ControlSettings):
    RENAMED: ClassVar[Mapping[str, str]] = {'rate': 'number', 'pace': 'number'}


def test_a_kind_has_the_earlier_names_of_all_its_bases_its_own_first() -> None:
    both = updated(Both(), {'amount': 4, 'room': 0.5}, 'a file')
    assert (both.number, both.spiral_ratio) == (4, 0.5)
    for name in ('rate', 'pace'):
        assert updated(Both(), {name: 6}, 'a file').number == 6
    assert updated(Renamed(), {'pace': 6}, 'a file').speed == 6.0


@pytest.mark.parametrize('name', ['auxiliary_features', 'passing_features'])
def test_a_setting_that_is_gone_is_refused_in_one_line(name: str) -> None:
    with pytest.raises(ValueError, match=f'^a file has no setting {name} any more; leave it out$'):
        updated(TrackerSettings(), {'levels': 3, name: 0}, 'a file')


def test_a_broken_estimator_is_refused_before_there_is_an_image(monkeypatch) -> None:
    group = 'visual_servo_epipolar.estimators'
    points = [EntryPoint('broken', 'math:no_such_thing', group)]
    monkeypatch.setattr(registry, 'entry_points', lambda group: points)
    for kind in (PerceptionSettings, ServoSettings):
        with pytest.raises(ValueError, match=f'^broken of {group} cannot be loaded from math:no'):
            kind(estimator='broken')
