"""Files that appear whole, by rename, or stay as they were."""

from pathlib import Path

import pytest

from visual_servo_epipolar.files import whole


def test_a_file_is_replaced_when_the_block_ends_and_stays_if_it_raises(tmp_path: Path) -> None:
    path = tmp_path / 'told.txt'
    path.write_text('before')
    with whole(path) as partial:
        partial.write_text('after')
        assert path.read_text() == 'before'
    assert path.read_text() == 'after'
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(OSError, match='full'), whole(path) as partial:
        partial.write_text('half')
        raise OSError('the disk is full')
    assert path.read_text() == 'after'
    assert list(tmp_path.iterdir()) == [path]
