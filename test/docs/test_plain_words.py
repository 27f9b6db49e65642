"""Words for people are not said of robots, cameras, nodes and estimates."""

from pathlib import Path
import re

ROOT = Path(__file__).parents[2]
FILES = [
    *sorted((ROOT / 'visual_servo_epipolar').rglob('*.py')),
    *sorted((ROOT / 'launch').glob('*.py')),
    *sorted({*ROOT.glob('*.md'), *(ROOT / 'docs').rglob('*.md')}),
]
WORDS = re.compile(
    r'\b(nobody|anybody|told|has it|and no more|as good as|by turns|whom|'
    r'(?<!people )(?<!person )(?<!driver )(?<!somebody )who)\b',
    re.IGNORECASE,
)


def test_no_line_has_a_word_for_people_alone() -> None:
    found = [
        f'{path.relative_to(ROOT)}:{number}: {line.strip()}'
        for path in FILES
        for number, line in enumerate(path.read_text(encoding='utf-8').splitlines(), start=1)
        if WORDS.search(line)
    ]
    assert found == [], '\n'.join(found)
