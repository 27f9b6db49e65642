"""What a reader needs is in the figures: the data, its units, the phases."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import combinations
import json
import math
from operator import attrgetter
from pathlib import Path
from typing import Any

import cv2
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
import pytest
from servo_states import PHASES

from visual_servo_epipolar.core.arrays import FloatArray
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.geometry.motion import DESIRED_POSE, HALF_PI, Pose, Twist
from visual_servo_epipolar.core.laws.registry import GREY, phase_colour
from visual_servo_epipolar.core.servo.run_log import end_s, RunLog, Sample
from visual_servo_epipolar.report.figures import robust_limit, save, signals, trajectory
from visual_servo_epipolar.report.run_file import load_run, RunFile, save_run
from visual_servo_epipolar.report.style import (
    rgb,
    robot_body,
    robot_nose,
    text_colour_on,
    view_wedge,
)

Draw = Callable[[RunLog], Figure]


def panel(figure: Figure, label: str) -> Axes:
    return next(axes for axes in figure.axes if axes.get_ylabel().replace('\n', ' ') == label)


def words(figure: Figure) -> set[str]:
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes)]
    return {text.get_text() for legend in legends if legend for text in legend.get_texts()}


def test_path_has_every_pose_and_one_line_a_phase(log: RunLog) -> None:
    lines = trajectory(log).axes[0].get_lines()
    words = {phase.value for phase in PHASES}
    stretches = [line.get_xydata() for line in lines if line.get_label() in words]
    # A stretch ends on the first pose of the next one, so that the path has no gaps.
    joined = np.concatenate([s[:-1] for s in stretches[:-1]] + [stretches[-1]])
    np.testing.assert_array_equal(joined, [(s.pose.x, s.pose.y) for s in log.samples])
    assert len(stretches) == len({sample.phase for sample in log.samples})


def test_close_up_is_in_millimetres(log: RunLog) -> None:
    close = trajectory(log).axes[-1]
    ends = [line.get_xydata()[-1] for line in close.get_lines()]
    final = log.samples[-1].pose
    assert any(np.allclose(end, (1000.0 * final.x, 1000.0 * final.y)) for end in ends)
    assert (close.get_xlabel(), close.get_ylabel()) == ('x [mm]', 'y [mm]')
    assert close.get_xlim() == (-100.0, 100.0)


def drawn(figure: Figure, label: str, line: str = '_child0') -> FloatArray:
    lines = {str(each.get_label()): each for each in panel(figure, label).get_lines()}
    return np.asarray(lines[line].get_ydata(), dtype=np.float64)


def changed(log: RunLog, **columns: Sequence[Any]) -> RunLog:
    """Return the run with other values of its samples."""
    rows = (dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True))
    pairs = zip(log.samples, rows, strict=True)
    return replace(log, samples=[replace(sample, **row) for sample, row in pairs])


@pytest.mark.parametrize('outcome', ['arrived', 'failed'])
def test_title_has_start_and_errors_and_the_reason_of_a_failure(log: RunLog, outcome: str) -> None:
    figure = trajectory(replace(log, outcome=outcome, reason='too dark'))
    title, final = next(text.get_text() for text in figure.texts), log.samples[-1].pose
    assert f'{1000.0 * final.distance:.1f} mm' in title
    assert f'{math.degrees(final.heading_error):+.2f} deg' in title
    assert 'x -0.6 m, y -3 m, heading +8 deg' in title
    assert ('too dark' in title) == ('\n' in title) == (outcome == 'failed')


@pytest.mark.parametrize('draw', [trajectory, signals])
def test_legend_names_the_phases_and_axes_have_units(draw: Draw, log: RunLog) -> None:
    figure = draw(log)
    assert {sample.phase.value.replace('_', ' ') for sample in log.samples} <= words(figure)
    for axes in figure.axes:
        if axes.axison and axes.get_ylabel() != 'visible\nfeatures':
            assert '[' in axes.get_ylabel()


def test_panels_show_the_log(log: RunLog) -> None:
    figure = signals(log)
    for label, line, field in (
        ('epipoles [px]', 'current $e_{au}$', 'epipole_current'),
        ('epipoles [px]', 'desired $e_{du}$', 'epipole_desired'),
        ('D [px$^2$]', '_child0', 'feature_difference'),
        ('visible features', '_child0', 'features'),
        ('median feature error [px]', '_child0', 'feature_error'),
        ('linear velocity [m/s]', '_child0', 'twist.linear'),
        ('angular velocity [rad/s]', '_child0', 'twist.angular'),
    ):
        expected = list(map(attrgetter(field), log.samples))
        np.testing.assert_array_equal(drawn(figure, label, line), expected, label)
    dashed = [line for line in figure.axes[1].lines if line.get_linestyle() == '--']
    assert end_s(log) in [line.get_xdata()[0] for line in dashed]  # where it arrived


def test_recorded_commands_stand_behind_those_of_a_replay(log: RunLog) -> None:
    recorded = np.full((len(log.samples), 2), (2.0, math.nan))
    axes = panel(signals(log, recorded), 'linear velocity [m/s]')
    line = next(line for line in axes.get_lines() if line.get_label() == 'recorded')
    assert set(line.get_ydata()) == {2.0}
    assert line.get_zorder() < axes.get_lines()[0].get_zorder()
    assert axes.get_ylim()[1] > 2.0


@pytest.mark.parametrize('differences', [(-2e5, -20.0), (-2e5, 3e5), (-5.0, -0.1), (0.0, 0.0)])
def test_odd_values_can_be_read_off(log: RunLog, differences: tuple[float, float]) -> None:
    count = len(log.samples)
    odd = changed(
        log,
        pose=[DESIRED_POSE] * count,  # as a replay has it, without ground truth
        twist=[Twist(0.3, 0.0)] * count,
        epipole_current=[math.inf if k == 40 else 1.0 for k in range(count)],
        feature_difference=np.linspace(*differences, count).tolist(),
    )
    figure = signals(odd)
    assert np.isnan(drawn(figure, 'distance [m]')).all()
    assert panel(figure, 'distance [m]').texts[0].get_text() == 'not measured'
    low, high = panel(figure, 'linear velocity [m/s]').get_ylim()
    assert low < 0.0 and high > 0.3
    axes = panel(figure, 'D [px$^2$]')
    low, high = axes.get_ylim()
    assert 1 <= sum(low <= it <= high for it in axes.get_yticks()) <= 9  # ticks are few
    assert low <= min(differences) and max(differences) <= high
    axes = panel(figure, 'epipoles [px]')
    gap, mark = (line.get_ydata() for line in axes.get_lines()[:2])
    assert math.isnan(gap[40]) and 0.0 < mark[0] < axes.get_ylim()[1]


def test_robust_limit_ignores_what_runs_off_and_what_is_not_there() -> None:
    steady = np.full(100, 200.0)
    steady[:2] = math.inf, 1e9
    assert robust_limit(steady, np.full(3, math.nan)) == pytest.approx(250.0)
    assert robust_limit(np.full(3, math.nan)) == 10.0


@pytest.mark.parametrize('draw', [trajectory, signals])
def test_figure_is_written_as_png_and_leaves_nothing_else(draw, log, tmp_path) -> None:
    figure = draw(log)
    path = save(figure, tmp_path / 'figure.png')
    assert list(tmp_path.iterdir()) == [path]
    width, height = figure.get_size_inches()
    image = cv2.imread(str(path))
    assert image is not None
    assert image.shape == (round(150 * height), round(150 * width), 3)
    with pytest.raises(ValueError, match='not supported'):
        save(figure, tmp_path / 'figure.docx')
    assert list(tmp_path.iterdir()) == [path]


def test_single_sample_without_measurements_can_be_drawn(log: RunLog, tmp_path: Path) -> None:
    nothing = [Sample(0, log.samples[0].pose)]
    short = replace(log, samples=nothing, outcome='failed', reason='no image')
    save(trajectory(short), tmp_path / 't.png')
    figure = signals(short)
    save(figure, tmp_path / 's.png')
    assert panel(figure, 'D [px$^2$]').texts[0].get_text() == 'not measured'


# What those who lack one kind of cone see of linear red, green, blue (Vienot, Brettel and Mollon
# 1999).
NORMAL = np.eye(3)
DEUTERANOPIA = np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1]])
PROTANOPIA = np.array([[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1]])


def perceived(colour: str, eye: FloatArray) -> FloatArray:
    linear = (np.array(rgb(colour)) / 255.0) ** 2.2
    return np.asarray(255.0 * np.clip(eye @ linear, 0.0, 1.0) ** (1.0 / 2.2), dtype=np.float64)


@pytest.mark.parametrize('eye', [NORMAL, DEUTERANOPIA, PROTANOPIA])
def test_phases_differ_even_to_the_colour_blind(eye: FloatArray) -> None:
    for one, other in combinations(PHASES, 2):
        colours = [perceived(phase_colour(phase.value), eye) for phase in (one, other)]
        # Thirty of 441: the closest pair of the palette of Okabe and Ito is at 37.
        assert np.linalg.norm(colours[0] - colours[1]) > 30.0, (one, other)
    assert phase_colour('tracking') == GREY  # a word that is no phase
    assert GREY not in [phase_colour(phase.value) for phase in PHASES]
    assert (text_colour_on('#FFFFFF'), text_colour_on('#0072B2')) == ('#000000', '#FFFFFF')


def test_robot_points_along_its_heading() -> None:
    body, nose = (shape(Pose(1.0, 2.0, HALF_PI)) for shape in (robot_body, robot_nose))
    np.testing.assert_allclose(np.ptp(body, axis=0), (0.40, 0.45))
    np.testing.assert_allclose(nose[0], (1.0, 2.20))


def test_a_view_opens_from_the_camera_by_its_angle_and_all_around_has_no_corner() -> None:
    wedge = view_wedge(Pose(1.0, 0.0, 0.0), angle=1.2, reach=2.0)
    np.testing.assert_allclose(wedge[0], (1.0, 0.0))
    np.testing.assert_allclose(wedge[-1], (1.0 + 2.0 * math.cos(0.6), 2.0 * math.sin(0.6)))
    circle = view_wedge(Pose(2.0, -1.0, 0.3), angle=math.tau, reach=0.5)
    assert np.hypot(*(circle - (2.0, -1.0)).T) == pytest.approx(0.5)


def test_a_run_comes_back_to_the_last_bit(log, tmp_path) -> None:
    with pytest.raises(InputError, match=r'run\.json: run cannot be read: No such file'):
        load_run(tmp_path)
    first, *others = log.samples
    blind = replace(log, samples=[replace(first, feature_error=math.nan), *others])
    run = RunFile(blind, {'servo': {'k1': 0.1, 'law': 'full'}}, {'numpy': '2.0'})
    text = save_run(run, tmp_path).read_text()
    loaded = load_run(tmp_path)
    whole = replace(run, log=replace(blind, samples=tuple(blind.samples)))
    assert repr(loaded) == repr(whole)  # for nan is not equal to itself
    assert [path.name for path in tmp_path.iterdir()] == ['run.json']
    assert 'NaN' not in text and json.loads(text)['samples']['feature_error'][0] is None


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        ({'format': 2}, 'format must be 1, got 2'),
        ({'samples': {}}, 'it has no samples'),
        ({'samples': 3}, 'not a run'),
        ({'start': [1, 2]}, 'not enough values'),
        ({'start': 'abc'}, 'could not convert'),
        ({'settings': 3}, 'not a run'),
        ({'limits': {'speed': 1.0}}, 'not a run'),
    ],
)
def test_another_document_is_refused(log, tmp_path, change, reason) -> None:
    path = save_run(RunFile(log), tmp_path)
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(InputError, match=reason):
        load_run(tmp_path)


def test_a_damaged_file_is_always_one_clear_error(log, tmp_path) -> None:
    data, rng, refused = save_run(RunFile(log), tmp_path).read_bytes(), np.random.default_rng(0), 0
    for _ in range(100):
        damaged = bytearray(data)
        damaged[int(rng.integers(len(data)))] ^= 1 << int(rng.integers(8))
        if rng.integers(2):
            del damaged[int(rng.integers(len(data))) :]
        (tmp_path / 'run.json').write_bytes(damaged)
        try:
            load_run(tmp_path)
        except InputError as error:
            refused += 1
            assert 'run.json: ' in str(error)
            assert '\n' not in str(error)
    assert refused > 50
