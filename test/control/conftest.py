"""The world that grip laws are judged in."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

FILE = Path(__file__).parents[1] / 'reference' / 'grip_world.py'


@pytest.fixture(scope='session')
def worlds() -> ModuleType:
    """Module of the reference world."""
    spec = importlib.util.spec_from_file_location('grip_world', FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclass looks itself up
    spec.loader.exec_module(module)
    return module
