"""Report: every command behind the page of results, one after the other, kept in a folder."""

from collections.abc import Callable, Mapping
import os
from pathlib import Path
import platform
import re
import subprocess
import sys
from time import monotonic
from typing import Any

from visual_servo_epipolar.commands.main import BAD_INPUT, INTERRUPTS, SIGNALLED
from visual_servo_epipolar.commands.outputs import OutputFolder
from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.evaluation.benchmarks.command import USUAL
from visual_servo_epipolar.files import write_whole
from visual_servo_epipolar.messages.settings_text import installed_versions
from visual_servo_epipolar.sweeping.provenance import commit

# Exit codes; others are those of a judged run.
UNFINISHED = {BAD_INPUT, *(SIGNALLED + number for number in INTERRUPTS)}
BOTH = '--compare full,smooth'
# What the page of results shows, by the name of its section; {out} is a folder for the runs.
COMMANDS: Mapping[str, str] = {
    **{
        f'{region}_{scenario}': f'sweep --region {region} --scenario {scenario} --runs {runs} '
        f'--seed 303 {BOTH} --out {{out}}'
        for region, scenario, runs in (
            ('front', 'nominal', 300),
            ('beside', 'nominal', 150),
            ('anywhere', 'realistic', 100),
            ('front', 'flat', 60),
            ('front', 'harsh', 60),
            ('anywhere', 'harsh', 40),
        )
    },
    'front_images': f'sweep --region front --source images --runs 40 --seed 303 {BOTH} '
    '--scenes 101-110 --out {out}',
    **{
        name: f'sweep --region front --scenario {name} --runs 24 --seed 21 {BOTH} --out {{out}}'
        for name in ('cheap', 'rough', 'nearwall', 'nearwall_boxes')
    },
    **{f'bench_{name}': f'bench {name}' for name in USUAL},
    **{
        name: 'route demo --way short --scenario realistic --law smooth --runs 30 '
        f'--world {world} --out {{out}}'
        for name, world in (('routes', 'same'), ('routes_changed', 'all'))
    },
    'faults': 'faults --runs 200 --seed 60',
    'paper': 'reproduce all --out {out}',
}


def run(
    *,
    seed: int,
    quick: bool,
    say: Callable[[str], None],
    out: str | None,
    commands: Mapping[str, str] = COMMANDS,
) -> dict[str, Any]:
    """
    Run each of ``commands`` that has no section in the folder ``out`` yet; write the page.

    ``seed`` is not used, since each command has the seed of its table. Raises InputError if a
    command cannot do its work; what ended before is kept.
    """
    folder = OutputFolder(out or 'bench_report')
    folder.check()
    sections: dict[str, str] = {}
    for number, (name, words) in enumerate(commands.items(), 1):
        path = Path(folder) / f'{name}.md'
        if not path.exists():
            say(f'report: {number} of {len(commands)}, visual_servo {words} ...')
            section = _section(name, shorter(words) if quick else words, Path(folder) / name)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, section.encode())
        sections[name] = path.read_text(encoding='utf-8')
    document = {'folder': str(folder), 'sections': sections}
    write_whole(Path(folder) / 'results.md', table(document).encode())
    return document


def shorter(words: str) -> str:
    """Return the command for a look whether it works: one run, or a few trials."""
    quick = ' --quick' if words.startswith('bench ') else ''
    return re.sub(r'--runs \d+', '--runs 1', words) + quick


def _section(name: str, words: str, out: Path) -> str:
    """Run the command and return its section, with commit, machine and time."""
    began = monotonic()
    line = [sys.executable, '-m', 'visual_servo_epipolar', *words.format(out=out).split()]
    ended = subprocess.run(line, stdout=subprocess.PIPE, text=True, check=False)
    code = ended.returncode
    if code < 0 or code in UNFINISHED:
        raise InputError(
            f'visual_servo {words} ended with code {code}, for the reason above; start the report '
            'again when that is mended: it goes on from here'
        )
    versions = ', '.join(f'{name} {version}' for name, version in installed_versions().items())
    return '\n'.join(
        [
            f'## {name}',
            '',
            f'`visual_servo {words.format(out=name)}`: exit code {code} after '
            f'{monotonic() - began:.0f} s; commit {commit() or "unknown"}; {versions}; '
            f'{platform.machine()}, {os.cpu_count()} processors.',
            '',
            '~~~text',
            ended.stdout.strip(),
            '~~~',
            '',
        ]
    )


def table(document: Mapping[str, Any]) -> str:
    """Return the page: a section a command."""
    return '\n'.join(['# Results', '', *document['sections'].values()])
