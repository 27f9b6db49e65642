"""The order of what follows an image: nothing that can wait goes before the twist."""

import pytest
from servo_rig import Rig, tracks

from visual_servo_epipolar.core.servo.session import Session
from visual_servo_epipolar.nodes.servoing.commands import Commands
from visual_servo_epipolar.nodes.servoing.reports import Reports


def test_the_twist_goes_out_before_the_reports_and_before_anything_is_learnt(
    bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []
    for owner, name in ((Commands, 'answer'), (Reports, 'step'), (Session, 'update_map')):
        kept = getattr(owner, name)

        def noted(*values: object, kept=kept, name: str = name) -> object:
            calls.append(name)
            return kept(*values)

        monkeypatch.setattr(owner, name, noted)
    rig = Rig(bench)
    rig.send(tracks())
    bench.until(lambda: 'update_map' in calls, 'the tracks to lead to a step')
    assert calls[:3] == ['answer', 'step', 'update_map']
