"""The ablation benchmark: which laws it compares, and the rows that it makes of their runs."""

from dataclasses import replace
import json

from visual_servo_epipolar.core.estimate.settings import DEPARTURES
from visual_servo_epipolar.core.laws.registry import LAWS
from visual_servo_epipolar.core.servo.settings import ServoSettings
from visual_servo_epipolar.evaluation.benchmarks import ablation


def test_each_departure_is_left_out_of_full_and_added_to_the_paper_once() -> None:
    laws, options = ablation.laws(), {}
    for name, taken in laws.items():
        options[name] = ServoSettings(**taken).options
    assert (options['full'], options['paper']) == (LAWS['full'], LAWS['paper'])
    assert options['full without retreat'] == replace(LAWS['full'], retreat=False)
    assert options['paper with true_sigma'] == LAWS['corrected']
    assert len(laws) == len(set(options.values())) == 2 * (1 + len(DEPARTURES))
    # Each row but the first two differs from its law in one departure.
    for name, row in options.items():
        law = options[name.split()[0]]
        differing = [it for it in DEPARTURES if getattr(row, it) != getattr(law, it)]
        assert differing == name.split()[2:]


def test_a_quick_run_has_a_row_for_each_of_its_laws() -> None:
    document = ablation.run(seed=0, quick=True, say=lambda text: None)
    rows = document['rows']
    assert [(row['law'], row['region']) for row in rows] == [
        (law, 'front') for law in ablation.QUICK_LAWS
    ]
    assert document['starts'] == 1
    assert document['departures'] == DEPARTURES
    assert not any('runs' in row for row in rows) and json.dumps(document)
    full, without_retreat, _ = rows
    # Point features from the front: full always arrives, and has nothing to retreat from.
    assert full['success_rate'] == without_retreat['success_rate'] == 1.0
    assert full['arrived_but_wrong'] == 0
    lines = ablation.table(document).splitlines()
    assert [line.split(' | ')[0] for line in lines[4:]] == [
        f'| {it}' for it in ablation.QUICK_LAWS
    ]
