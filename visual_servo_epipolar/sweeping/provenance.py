"""Provenance: a digest of the code of a run, equal for all copies of it, and the commit."""

from functools import cache
import hashlib
from pathlib import Path
import subprocess

PACKAGE = Path(__file__).resolve().parents[1]


@cache
def digest() -> str:
    """Return twelve digits that change when the code of a run changes."""
    digester = hashlib.sha256()
    for layer in ('core', 'simulation', 'sweeping'):  # they make the runs what they are
        for path in sorted((PACKAGE / layer).rglob('*.py')):
            digester.update(path.relative_to(PACKAGE).as_posix().encode())
            digester.update(hashlib.sha256(path.read_bytes()).digest())
    return digester.hexdigest()[:12]


@cache
def commit() -> str | None:
    """Return the commit of the code, '+' if it was edited since; None outside a repository."""
    if _git('ls-files', '--error-unmatch', '__init__.py') is None:
        return None
    name = _git('rev-parse', '--short', 'HEAD')
    edited = _git('status', '--porcelain', '--', '.')
    return None if name is None else name + ('+' if edited else '')


def _git(*arguments: str) -> str | None:
    try:
        process = subprocess.run(
            ['git', '-C', str(PACKAGE), *arguments],
            capture_output=True,
            text=True,
            timeout=5.0,
            check=True,
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return process.stdout.strip()
