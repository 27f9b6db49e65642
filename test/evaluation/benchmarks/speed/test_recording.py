"""Recording of full-size images beside the running loop: nothing is missing in the bag."""

import json

import pytest

pytest.importorskip('rclpy')

from visual_servo_epipolar.evaluation.benchmarks.speed import recording

pytestmark = [pytest.mark.alone, pytest.mark.long]


@pytest.fixture(scope='module')
def document() -> dict:
    return recording.run(seed=0, quick=True, say=lambda _: None)


def test_no_image_is_missing(document) -> None:
    (bag,) = document['bags']
    assert bag['published'] == recording.RATE * recording.QUICK_TURN_S
    assert (bag['missing'], bag['in_order']) == (0, True)
    assert bag['mb'] > bag['published'] * 1.3


def test_the_servo_answers_with_and_without_a_recorder(document) -> None:
    for name in ('without', 'with'):
        it = document[name]
        assert it['answers'] > 0
        assert 0.0 < it['p50'] <= it['p95'] <= it['p99']


def test_the_document_is_json_and_a_table(document) -> None:
    text = recording.table(json.loads(json.dumps(document)))
    assert 'with a recorder' in text
    assert text.splitlines()[-1].startswith('0 ')
