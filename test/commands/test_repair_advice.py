"""A bag that cannot be read after its repair: the advice is not to repair it once more."""

from bagmaker import write_bag
import pytest

from visual_servo_epipolar.commands.main import main


@pytest.mark.parametrize('repair', [False, True])
def test_who_has_repaired_is_not_sent_to_repair_again(small_run, tmp_path, capsys, repair) -> None:
    broken = [
        (topic, stamp_ns, data[: len(data) // 2] if topic == '/tracks' else data)
        for topic, stamp_ns, data in small_run
    ]
    bag = write_bag(tmp_path / 'bag', broken)
    assert main(['replay', str(bag), '--tracks', *(['--repair'] * repair)]) == 2
    complaint = capsys.readouterr().err
    assert complaint.count('\n') == 1
    assert ('try --repair' in complaint) is not repair
