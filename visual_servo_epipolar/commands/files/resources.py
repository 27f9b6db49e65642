"""Resources under config/: beside the source, or under share/ of an installation."""

from collections.abc import Iterator
import os
from pathlib import Path
import sys

from visual_servo_epipolar.core.errors import InputError
from visual_servo_epipolar.core.settings import alike

PACKAGE = 'visual_servo_epipolar'


def config_folders() -> Iterator[Path]:
    """Yield the folders that may hold the configuration, nearest first."""
    yield Path(__file__).resolve().parents[3] / 'config'
    for prefix in filter(None, os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)):
        yield Path(prefix) / 'share' / PACKAGE / 'config'
    yield Path(sys.prefix) / 'share' / PACKAGE / 'config'


def scenario_path(name: str) -> Path:
    """Return the scenario file called ``name``: a path, or the name of an installed one."""
    if Path(name).is_file():
        return Path(name)
    installed = [folder / 'scenarios' for folder in config_folders()]
    for folder in installed:
        if (folder / f'{name}.yaml').is_file():
            return folder / f'{name}.yaml'
    names = sorted({path.stem for folder in installed for path in folder.glob('*.yaml')})
    close = alike(name, names)
    meant = f'; did you mean {close[0]}?' if close else ''
    raise InputError(
        f'no scenario file {name!r}; give a path, or one of '
        f'{", ".join(names) or "none installed"}{meant}'
    )
