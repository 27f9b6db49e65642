"""Programs that are in no package, as modules."""

import importlib.util
from pathlib import Path
import sys
from types import ModuleType


def loaded(path: Path) -> ModuleType:
    """Return the file at ``path`` as a module."""
    spec = importlib.util.spec_from_file_location(path.name.replace('.', '_'), path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module
