"""The paper's simulations and its experiment anew, and a plain second writing of them."""

from dataclasses import replace
import json
from pathlib import Path
from types import ModuleType

from command_line import refusal
import cv2
from loaded import loaded
from matplotlib.figure import Figure
import numpy as np
import pytest

from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.servo.run_log import summarise
from visual_servo_epipolar.core.tracking.features import Features
from visual_servo_epipolar.evaluation.reproduction import continuous
from visual_servo_epipolar.evaluation.reproduction.chapters import (
    chapter_1,
    chapter_2,
    POINTS,
)
from visual_servo_epipolar.evaluation.reproduction.continuous import (
    PointCamera,
    Simulation1,
    Simulation2,
    SIMULATION_1,
    simulation_1,
    simulation_2,
    transient,
)
from visual_servo_epipolar.evaluation.reproduction.experiment import (
    claims,
    epipoles,
    evenly_moved,
    Experiment,
    experiment,
    experiment_scenario,
    FEATURES,
    FOCAL_PX,
    PRINTED_K_T,
    servo,
    split,
    well_spread,
)
from visual_servo_epipolar.evaluation.reproduction.paper import decay, figure_data, thin
from visual_servo_epipolar.evaluation.reproduction.simulations import claims_1, claims_2


def test_numbers_are_those_of_the_paper() -> None:
    case = SIMULATION_1
    assert (case.focal, case.k1, case.k2, case.k_t) == (0.03, 0.5, 0.5, 100.0)
    assert (case.exponent, case.initial_distance, case.tolerance) == (5 / 9, 2.0, 1e-9)
    assert (case.start.x, case.start.y, np.degrees(case.start.theta)) == (1.0, 1.0, 90.0)
    assert len(PointCamera(0.03, 0.03).points) == 8


def test_printed_sign_fails_behind_the_goal_where_the_true_one_arrives(runs_1) -> None:
    assert runs_1.behind_printed.outcome == 'e_au passed through infinity'
    assert runs_1.behind_corrected.outcome == 'arrived'
    np.testing.assert_allclose(
        runs_1.behind_corrected.column('pose.y', 1),
        -runs_1.corrected.column('pose.y', 1),
        atol=1e-6,
    )


def test_guess_that_sends_the_robot_among_the_points_is_reported() -> None:
    wild = continuous.run(replace(SIMULATION_1, initial_distance=20.0))
    assert wild.outcome == 'a point left the half-space before the camera'
    assert np.isnan(wild.zeroed_at)


def test_claims_disagree_where_the_paper_is_wrong_and_nowhere_else(runs_1, runs_2) -> None:
    statements = [*claims_1(runs_1), *claims_2(runs_2)]
    wrong = [s.place for s in statements if s.agrees is False]
    assert wrong == ['sign', 'sign', 'VI, end']
    assert all(s.agrees is not None or 'no number' in s.paper for s in statements)


def test_point_behind_the_camera_is_no_image() -> None:
    assert np.isnan(PointCamera(0.03, 0.03).image(Pose(0.0, 8.0, np.pi / 2))).any()


def test_a_decay_is_found() -> None:
    time = np.linspace(0.0, 5.0, 50)
    fit = decay(time, -3.0 * np.exp(-0.7 * time))
    assert (fit.rate, fit.initial) == (pytest.approx(0.7), pytest.approx(3.0))
    np.testing.assert_allclose(fit.at(time), 3.0 * np.exp(-0.7 * time))
    with pytest.raises(ValueError, match='three values'):
        decay(time, 0.0 * time)


def test_simulation_2_writes_figures_table_data_and_json(tmp_path, capsys) -> None:
    out, result = tmp_path / 'out', tmp_path / 'result.json'
    assert main(['reproduce', 'sim2', '--out', str(out), '--json', str(result)]) == 0
    assert {path.name for path in out.iterdir()} == {
        *('figure_14.png', 'figure_15.png', 'figures.json', 'table.md')
    }
    assert all(cv2.imread(str(path)).std() > 0.0 for path in out.glob('*.png'))
    assert set(json.loads((out / 'figures.json').read_text())) == {'figure_14', 'figure_15'}
    document = json.loads(result.read_text())['sim2']
    assert document['succeeded'] is True
    assert document['numbers']['course']['outcome'] == 'arrived'
    table = (out / 'table.md').read_text()
    assert all(f'| {s["place"]} |' in table for s in document['statements'])
    assert 'DISAGREES' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['sim3', '--out', 'x'], 'invalid choice'),
        (['sim1'], 'required: --out'),
        (['sim1', '--out', '/dev/null/x'], 'nothing can be written there'),
    ],
)
def test_bad_usage_is_one_line(capsys, arguments, reason) -> None:
    assert reason in refusal(capsys, 'reproduce', *arguments)


def test_data_are_what_is_drawn_and_keep_both_ends() -> None:
    axes = Figure().subplots()
    x = np.linspace(0.0, 1.0, 1001)
    axes.plot(x, x**2, label='a')
    axes.axhline(1.0)  # no label: an aid to the eye
    current = thin(figure_data(axes.figure), 11)
    assert list(current) == ['0: a']
    np.testing.assert_allclose(current['0: a'], np.stack([x, x**2], axis=1)[::100])


HERE = Path(__file__).parent
# Of the largest value of each line. Simulations: what another BLAS and compiler may change; point
# features: arithmetic alone, but 900 steps of a closed loop, in which LMedS decides.
STORED = ('figures.json', 1e-6, 8.0), ('figures_points.json', 1e-3, 7.0)  # and the least font
# Images: another OpenCV draws and tracks a little differently, and LMedS is noisy.
IMAGE_TOLERANCE, IMAGE_TOLERANCE_PX = 0.05, 20.0
SHORT_S = 11.0


@pytest.fixture(scope='module')
def runs_1() -> Simulation1:
    return simulation_1()


@pytest.fixture(scope='module')
def runs_2() -> Simulation2:
    return simulation_2()


@pytest.fixture(scope='module')
def points() -> ModuleType:
    return loaded(HERE / 'points.py')


@pytest.fixture(scope='module')
def run(points) -> Experiment:
    return points.experiment_with_points()


def test_settings_are_those_of_the_paper() -> None:
    world = experiment_scenario()
    assert (world.camera.width, world.camera.height, FEATURES) == (1280, 1024, 26)
    assert (world.camera.principal_u, world.camera.principal_v) == (635.0, 512.0)
    assert 1.0 / world.camera.frame_rate == pytest.approx(0.09)
    gains = world.servo
    assert (gains.k1, gains.exponent, gains.initial_distance) == (0.08, 7 / 9, 12.0)
    # k2 = 1 for epipoles in pixels: f (f e)^(7/9) / f = k2 e^(7/9).
    assert gains.k2 * FOCAL_PX ** (2 / 9) == pytest.approx(1.0)
    assert (gains.law, gains.estimator, gains.dead_band_mode) == ('paper', 'lmeds_8pt', 'raise')
    assert PRINTED_K_T == 4e-4
    assert servo(k_t=PRINTED_K_T * FOCAL_PX**2).k_t == pytest.approx(236.7, abs=0.1)


@pytest.mark.long
def test_images_begin_as_in_the_stored_figure() -> None:
    run = experiment(lambda _: None, longest=SHORT_S)
    shown = figure_data(epipoles(run))
    stored = json.loads((HERE / 'figures.json').read_text(encoding='utf-8'))['figure_17']
    for line in ('0: actual $e_{au}$', '0: desired $e_{du}$'):
        time, expected = np.array(stored[line]).T
        rows = time < SHORT_S - 1.0
        assert rows.sum() > 10
        values = np.interp(time[rows], *shown[line].T)
        limit = IMAGE_TOLERANCE * np.abs(expected[rows]) + IMAGE_TOLERANCE_PX
        assert (np.abs(values - expected[rows]) < limit).all(), line
    assert all(len(features) == FEATURES for features in run.features)
    # e_du is zero, and the robot does not move on: it turns.
    last = run.log.samples[-1]
    assert abs(last.epipole_desired) < 10.0
    assert last.twist.linear == 0.0 and last.twist.angular < 0.0


def test_the_robot_arrives_within_the_four_centimetres_of_the_paper(run: Experiment) -> None:
    summary = summarise(run.log)
    assert summary['outcome'] == 'arrived'
    assert summary['position_error_m'] < 0.04
    assert summary['max_linear_speed'] <= 0.2 + 1e-9


@pytest.fixture(scope='module')
def drawn(points, run: Experiment, runs_1, runs_2) -> dict[str, Figure]:
    chapters = chapter_1(print, runs_1), chapter_2(print, runs_2)
    return {**chapters[0].figures, **chapters[1].figures, **points.drawn(run)}


@pytest.mark.parametrize('number', [*range(7, 16), *range(17, 21)])
def test_a_figure_is_that_of_the_paper_and_its_data_are_those_stored(drawn, number) -> None:
    name, (file, tolerance, font) = f'figure_{number:02d}', STORED[number > 15]
    figure, stored = drawn[name], json.loads((HERE / file).read_text(encoding='utf-8'))[name]
    shown = thin(figure_data(figure), POINTS)
    assert shown.keys() == stored.keys()
    for line, expected in stored.items():
        assert np.shape(shown[line]) == np.shape(expected), line
        limit = tolerance * np.abs(expected).max(axis=0) + 1e-12
        assert (np.abs(np.subtract(shown[line], expected)) <= limit).all(), line
    assert figure.texts[0].get_text().startswith(f'Fig. {number} ')
    assert figure.get_size_inches()[0] <= 7.2
    for axes in figure.axes:
        assert axes.get_xlabel().endswith(']') and axes.get_ylabel().endswith(']')
        sizes = [text.get_fontsize() for text in (axes.xaxis.label, axes.yaxis.label)]
        assert min(sizes) >= font  # points, on a page as wide as the figure


def test_snapshots_are_of_their_step_and_begin_and_end_with_it(run: Experiment) -> None:
    count = split(run.log)
    for rows in (range(count), range(count, len(run.log.samples))):
        moments = evenly_moved(run.log, rows)
        assert len(moments) == 6 and moments == sorted(moments)
        assert moments[0] == rows[0] and moments[-1] in rows


def test_claims_say_where_the_printed_numbers_do_not_work(run: Experiment) -> None:
    statements = claims(run)
    wrong = [s for s in statements if s.agrees is False]
    assert [s.place for s in wrong] == ['Fig. 18']
    assert 'k_t = 0.0004' in wrong[0].paper


def test_chosen_features_stay_and_lie_far_apart() -> None:
    rng = np.random.default_rng(0)
    places = rng.random((100, 2)) * 1000.0
    rest = {'ages': np.zeros(100), 'errors': np.zeros(100)}
    features = Features(np.arange(100), places, places + rng.random((100, 2)), **rest)
    first = well_spread(features, np.empty(0, int), 26)
    assert len(first) == 26
    gaps = np.linalg.norm(first.current[:, None] - first.current[None], axis=2)
    assert gaps[~np.eye(26, dtype=bool)].min() > 70.0  # a grid of 26 in the square: 196
    spread = well_spread(features, first.ids[:20], 26)
    assert set(first.ids[:20]) < set(spread.ids) and len(spread) == 26
    assert len(well_spread(Features(), first.ids, 26)) == 0


AGREEMENT = 1e-6  # m, rad, s, m/s, and of the focal length for epipoles


@pytest.fixture(scope='module')
def plain():
    return loaded(Path(__file__).with_name('plain.py'))


@pytest.fixture(scope='module')
def stages(plain, runs_1: Simulation1):
    time = runs_1.course.column('time', 2)
    return plain.simulation_1(time[-1] - time[0], PointCamera(0.03, 0.03).points)


def test_it_shares_no_code() -> None:
    source = Path(__file__).with_name('plain.py').read_text(encoding='utf-8')
    assert 'visual_servo' not in source


def test_the_desired_epipole_is_zero_at_the_same_time(stages, runs_1: Simulation1) -> None:
    assert runs_1.course.zeroed_at == pytest.approx(stages[3], abs=AGREEMENT)


def test_the_way_to_the_axis_is_the_same(plain, stages, runs_1: Simulation1) -> None:
    course, one = runs_1.course, stages[0]
    rows = transient(course, 'time') <= one.t[-1]
    state = one.sol(transient(course, 'time')[rows])
    names = ('pose.x', 'pose.y', 'pose.theta', 'distance_estimate')
    for name, expected in zip(names, state, strict=True):
        np.testing.assert_allclose(transient(course, name)[rows], expected, atol=AGREEMENT)
    e_current, e_desired = plain.epipoles(*state[:3])
    found = (('reading.e_current', e_current), ('reading.e_desired', e_desired))
    for name, expected in found:
        values = transient(course, name)[rows]
        np.testing.assert_allclose(values, expected, atol=AGREEMENT * plain.F)
    u = np.array([plain.first_step(0, q, 1) for q in state.T])
    forward = u[:, 0] * np.cos(state[2]) + u[:, 1] * np.sin(state[2])
    np.testing.assert_allclose(transient(course, 'twist.linear')[rows], forward, atol=AGREEMENT)
    np.testing.assert_allclose(transient(course, 'twist.angular')[rows], u[:, 2], atol=AGREEMENT)


def test_the_turn_at_its_end_is_the_same(stages, runs_1: Simulation1) -> None:
    course, two = runs_1.course, stages[1]
    time = course.column('time', 1)
    rows = (time >= two.t[0]) & (time <= two.t[-1])
    assert rows.sum() > 500
    theta = course.column('pose.theta', 1)[rows]
    np.testing.assert_allclose(theta, two.sol(time[rows])[2], atol=AGREEMENT)


def test_the_second_step_is_the_same(stages, runs_1: Simulation1) -> None:
    time = runs_1.course.column('time', 2)
    values = runs_1.course.column('pose.distance', 2)
    np.testing.assert_allclose(values, stages[2].sol(time - time[0])[0], atol=AGREEMENT)
