"""The report: every command of the page of results, kept as soon as it ends."""

import pytest

from visual_servo_epipolar.commands.main import parser
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.evaluation.benchmarks import report

SWEEP = 'sweep --region front --runs 1 --seed 3 --jobs 1 --out {out}'


@pytest.mark.parametrize('name', report.COMMANDS)
@pytest.mark.parametrize('form', [str, report.shorter])
def test_each_of_its_commands_is_understood_and_writes_where_it_is_to(name: str, form) -> None:
    words = form(report.COMMANDS[name]).format(out='here').split()
    options = parser(words).parse_args(words)
    assert callable(options.run)
    assert str(getattr(options, 'out', 'here')) == 'here'


def test_it_goes_on_after_a_command_that_cannot_work_and_keeps_what_ended(tmp_path) -> None:
    said: list[str] = []
    asked = {'seed': 0, 'quick': True, 'say': said.append, 'out': str(tmp_path)}
    with pytest.raises(InputError, match='nowhere ended with code 2'):
        report.run(**asked, commands={'first': SWEEP, 'second': 'replay nowhere'})
    document = report.run(**asked, commands={'first': SWEEP, 'second': 'gains --help'})
    assert len(said) == 3
    page = (tmp_path / 'results.md').read_text()
    assert page == report.table(document)
    for words in ('## first', '`visual_servo sweep --region front', '1 of 1', '## second'):
        assert words in page
