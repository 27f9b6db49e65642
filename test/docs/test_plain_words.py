"""Words for people alone are not said of robots, cameras, nodes and estimates."""

from pathlib import Path
import re

PACKAGE = Path(__file__).parents[2] / 'visual_servo_epipolar'
WORDS = re.compile(r'\b(nobody|told|has it|and no more)\b')
MOST = 0


def test_lines_with_words_for_people_become_no_more() -> None:
    found = [
        f'{path.relative_to(PACKAGE)}:{number}: {line.strip()}'
        for path in sorted(PACKAGE.rglob('*.py'))
        for number, line in enumerate(path.read_text(encoding='utf-8').splitlines(), start=1)
        if WORDS.search(line)
    ]
    assert len(found) <= MOST, '\n'.join(found)
