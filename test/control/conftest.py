# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""The world that grip laws are judged in."""

from __future__ import annotations

from types import ModuleType

import pytest

from reference import grip_world


@pytest.fixture(scope='session')
def worlds() -> ModuleType:
    """Module of the reference world."""
    return grip_world
