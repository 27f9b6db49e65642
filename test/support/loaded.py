"""Programs that are in no package, as modules; and what a page links, by its name."""

from importlib import import_module
import importlib.util
from pathlib import Path
import sys
from types import ModuleType
from typing import Any

ROOT = Path(__file__).parents[2]
DOCS = ROOT / 'docs'


def loaded(path: Path) -> ModuleType:
    """Return the file at ``path`` as a module."""
    spec = importlib.util.spec_from_file_location(path.name.replace('.', '_'), path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def linked(name: str, path: str) -> Any:
    """Return what a page of docs calls ``name``, as Bearings.alpha, in the file that it links."""
    file = (DOCS / path).resolve()
    root = DOCS if file.parent == DOCS else ROOT
    found: Any = import_module('.'.join(file.relative_to(root).with_suffix('').parts))
    first, _, rest = name.partition('.')
    for part in filter(None, (rest if first == file.stem else name).split('.')):
        fields = getattr(found, '__dataclass_fields__', {})
        found = fields[part] if part in fields else getattr(found, part)
    return found
