"""Modules of a source checkout outside the package: benches, worlds of the tests."""

from __future__ import annotations

import sys
from importlib.util import module_from_spec, spec_from_file_location
from typing import TYPE_CHECKING

from tactile_ros.errors import MissingPackageError

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType


def load_source(path: Path, who: str) -> ModuleType:
    """Import a file by its path, once.

    Parameters
    ----------
    path : Path
        Of the file; its stem names the module.
    who : str
        Needs it, as a sentence says.

    Returns
    -------
    ModuleType
        The module, kept in `sys.modules` so that its dataclasses find themselves.

    Raises
    ------
    MissingPackageError
        If there is no such file, or a package that it imports is missing.
    """
    name = f'tactile_source_{path.stem}'
    if name in sys.modules:
        return sys.modules[name]
    spec = spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except (ImportError, FileNotFoundError) as error:
        del sys.modules[name]
        msg = f'{who} needs {path.parent.name}/{path.name} of a source checkout: {error}'
        raise MissingPackageError(msg) from error
    return module
