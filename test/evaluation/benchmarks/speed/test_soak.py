"""The soak: real processes drive run after run."""

import json

import pytest

pytest.importorskip('rclpy')

from visual_servo_epipolar.evaluation.benchmarks.speed import soak
from visual_servo_epipolar.evaluation.live.chain import Answers
from visual_servo_epipolar.evaluation.live.processes import Cost

HELD = {'servo_node': Cost(1.0, 100.0, 120.0, 16, 23)}


def test_an_image_whose_twist_comes_after_the_next_is_due_is_missed() -> None:
    drive = Answers(
        sent=dict.fromkeys(range(10), 0.0),
        latencies=[0.05] * 6 + [0.15] * 3,
        answered=[0, *range(2, 10)],
    )
    row = soak._run_row(drive, 'arrived', 10.0, HELD)
    assert (row['images'], row['missed'], row['arrived']) == (10, 4, True)
    assert row['processes']['servo_node']['threads'] == 16


@pytest.mark.parametrize(
    ('phase', 'images'), [('arrived', 5), ('failed', 5), ('zeroing_epipoles', 8)]
)
def test_images_before_the_first_answer_and_after_the_end_of_a_run_do_not_count(
    phase, images
) -> None:
    sent, answered = dict.fromkeys(range(10), 0.0), [2, 3, 5, 6]
    row = soak._run_row(
        Answers(sent=sent, latencies=[0.05] * 4, answered=answered), phase, 10.0, HELD
    )
    assert (row['images'], row['missed']) == (images, images - 4)


@pytest.mark.long
def test_runs_begin_anew_and_what_processes_hold_is_told(monkeypatch) -> None:
    monkeypatch.setattr(soak, 'LONGEST_RUN_S', 2.0)
    document = soak.run(seed=0, quick=True, say=lambda _: None, seconds=3.0)
    assert len(document['runs']) == 2
    assert all(row['images'] > 0 for row in document['runs'])
    assert set(document['runs'][0]['processes']) == {
        'unicycle_node',
        'camera_node',
        'tracker_node',
        'servo_node',
    }
    text = soak.table(json.loads(json.dumps(document)))
    assert 'Soak: 2 runs of four processes' in text and '640x480 at 10 Hz' in text
    assert soak.figures(document).keys() >= {'missed deadlines [%]', 'servo_node grows by [MB]'}
