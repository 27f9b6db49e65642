"""Latency over the wire: every image is answered, as the run was driven, beside an echo."""

import json

import pytest

pytest.importorskip('rclpy')

from visual_servo_epipolar.evaluation.benchmarks import latency

pytestmark = [pytest.mark.alone, pytest.mark.long]
MOST = 0.5  # of the twists; where load drops an image, those after it are others for a while


@pytest.fixture(scope='module')
def document() -> dict:
    said: list[str] = []
    return latency.run(seed=0, quick=True, say=said.append, seconds=2.0)


def test_images_are_answered_by_nodes_and_echo(document) -> None:
    (row,) = document['rows']
    for name in ('nodes', 'echo'):
        it = row[name]
        assert 0 <= it['drops'] < it['images']
        assert 0.0 < it['p50'] <= it['p99'] <= it['p99.9']
    assert row['nodes']['moving'] > 0.0
    assert row['echo']['moving'] == 0.0
    for floor in (row['floor'], row['paced_floor']):
        assert floor['sum_ms'] == floor['echo_ms'] + floor['tracker_ms'] + floor['servo_ms']


def test_two_nodes_command_what_the_servo_did_that_drove_the_run(document) -> None:
    share = document['rows'][0]['nodes']['as_driven']
    assert MOST < share <= 1.0


def test_the_cost_of_each_process_is_counted(document) -> None:
    (row,) = document['rows']
    assert len(row['processes']) == 2
    for it in row['processes'].values():
        assert it['processor_ms'] > 0.0
        assert 0.0 < min(it['memory_mb']) <= it['peak_mb']


def test_the_document_is_json_and_a_table(document) -> None:
    text = latency.table(json.loads(json.dumps(document)))
    assert '640x480, 60 Hz' in text and 'servo_node' in text and 'as driven' in text
