"""Result of a replay: the run ends where its phase ended, however long the recording goes on."""

import json

from bagmaker import write_bag
import pytest

from visual_servo_epipolar.bags.reading.run import Recording
from visual_servo_epipolar.bags.replaying.replay import document, ReplayedStep, run_log
from visual_servo_epipolar.bags.replaying.replay import SETTLE_FRAMES as BRAKING_STEPS
from visual_servo_epipolar.commands.main import main
from visual_servo_epipolar.core.geometry.motion import Pose
from visual_servo_epipolar.core.laws.phase import Phase
from visual_servo_epipolar.simulation.run_monitor import SETTLE_FRAMES

PERIOD_NS = 100_000_000
TELEMETRY = {
    'linear_m_s': 0.1,
    'angular_rad_s': 0.0,
    'features': 30.0,
    'attempt': 1.0,
    **dict.fromkeys(
        (
            'epipole_current_px',
            'epipole_desired_px',
            'bearing_current_rad',
            'bearing_desired_rad',
            'feature_difference_px2',
            'feature_error_px',
            'distance_estimate_m',
        ),
        0.5,
    ),
}


def steps_of(**counts: int) -> list[ReplayedStep]:
    phases = [Phase.known[name] for name, count in counts.items() for _ in range(count)]
    return [
        ReplayedStep((number * PERIOD_NS, 0), number, phase, f'in {phase.value}', TELEMETRY)
        for number, phase in enumerate(phases)
    ]


def driving_away(steps: list[ReplayedStep]) -> Recording:
    """Return the ground truth of a robot that somebody drives on after the end."""
    poses = {item.key[0]: Pose(0.0, 0.01 * n, 1.0) for n, item in enumerate(steps)}
    return Recording(topics={}, poses=poses)


@pytest.mark.parametrize('phase', ['arrived', 'failed'])
def test_a_run_ends_where_it_arrived_or_failed(phase) -> None:
    steps = steps_of(displacing=20, **{phase: 300})
    log = run_log(driving_away(steps), steps, seed=0, law='full')
    result = document(log, truth=True)
    assert result['phases'][-1]['start_s'] == 2.0
    assert (result['outcome'], result['reason']) == (phase, f'in {phase}')
    assert len(log.samples) == 20 + BRAKING_STEPS
    assert result['longitudinal_error_m'] == pytest.approx(0.01 * (19 + BRAKING_STEPS))
    end_s = result['phases'][-1]['end_s']
    assert end_s == result['duration_s'] == pytest.approx(2.0 + 0.1 * (BRAKING_STEPS - 1))


def test_the_base_has_the_time_to_brake_that_a_live_run_gives_it() -> None:
    assert BRAKING_STEPS == SETTLE_FRAMES


def test_a_run_that_had_not_ended_lasts_as_long_as_its_bag() -> None:
    steps = steps_of(arrived=10, displacing=20)
    log = run_log(driving_away(steps), steps, seed=0, law='full')
    assert document(log, truth=True)['duration_s'] == pytest.approx(2.9)
    assert log.reason == 'the bag ends in displacing: in displacing'


def test_replay_and_report_tell_the_end_of_the_run_from_that_of_the_recording(
    small_run, tmp_path, capsys
) -> None:
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


def test_figures_mark_the_end_of_the_run() -> None:
    import numpy as np

    from visual_servo_epipolar.report.figures import comparison, Signals, signals

    steps = steps_of(displacing=20, failed=300)
    log = run_log(driving_away(steps), steps, seed=0, law='full')
    panel = signals(log).axes[1]
    assert 2.0 in [line.get_xdata()[0] for line in panel.lines if line.get_linestyle() == '--']
    both = Signals(np.array([0.0, 2.0, 32.0]), ['displacing', 'failed', 'failed'], {})
    marked = comparison(both, both, None, 2.0).axes[2]
    assert 'end of the run' in [text.get_text() for text in marked.get_legend().get_texts()]
    assert marked.get_xlim()[1] == 32.0
