"""Files that are there whole, or as before; and where those of the configuration are."""

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import sys

PACKAGE = 'visual_servo_epipolar'


@contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Yield the file to write in place of ``path``, renamed to it unless the block raises."""
    partial = path.with_name(f'.{path.name}.partial')
    try:
        yield partial
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def config_folders() -> Iterator[Path]:
    """Yield the folders that may hold the configuration, nearest first."""
    yield Path(__file__).resolve().parents[1] / 'config'
    for prefix in filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)):
        yield Path(prefix) / 'share' / PACKAGE / 'config'
    yield Path(sys.prefix) / 'share' / PACKAGE / 'config'


def config_names(kind: str) -> list[str]:
    """Return the names of all configuration files of a ``kind``: scenarios, rigs."""
    return sorted({p.stem for folder in config_folders() for p in (folder / kind).glob('*.yaml')})
