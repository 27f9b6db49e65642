"""The Python example of the README runs as it stands, and the robot arrives."""

from pathlib import Path
import re

README = Path(__file__).parents[2] / 'README.md'
BLOCK = re.compile(r'^```python\n(.*?)^```', re.M | re.S)


def test_the_example_of_the_readme_drives_the_robot_home(capsys) -> None:
    (example,) = BLOCK.findall(README.read_text(encoding='utf-8'))
    exec(compile(example, str(README), 'exec'), {})
    printed = capsys.readouterr().out
    assert re.fullmatch(r'arrived \d\.\d mm from the goal\n', printed), printed
