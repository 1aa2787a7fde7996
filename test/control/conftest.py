"""The world that grip laws are judged in."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import pytest

from tactile_ros.evaluation.sources import load_source

FILE = Path(__file__).parents[1] / 'reference' / 'grip_world.py'


@pytest.fixture(scope='session')
def worlds() -> ModuleType:
    """Module of the reference world."""
    return load_source(FILE, 'a test')
