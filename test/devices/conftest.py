# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""A simulated port with its driver, and a watch over what they leave behind."""

import contextlib
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tactile_ros.devices.serial_board import ReskinBoard
from tactile_ros.devices.simulated_serial import SimulatedSerialPort
from tactile_ros.types import Layout

OPENED = ('/dev/pts/', '/dev/ptmx', '/dev/i2c', 'pipe:')
"""What drivers and twins open; runtimes of other libraries open sockets as they please."""


def opened() -> list[str]:
    """Names of the open ports, buses and pipes of this process, one entry a descriptor."""
    names = []
    for link in Path('/proc/self/fd').glob('*'):
        with contextlib.suppress(FileNotFoundError):  # closed meanwhile, as the listing's own
            names.append(str(link.readlink()))
    return [name for name in names if name.startswith(OPENED)]


@pytest.fixture(autouse=True)
def nothing_left_behind() -> Iterator[None]:
    """Fail when a thread or a descriptor survives the test."""
    threads, files = threading.active_count(), opened()
    yield
    # fewer: what tests before this one had left was collected
    assert threading.active_count() <= threads
    assert len(left := opened()) <= len(files), (left, files)


@pytest.fixture
def layout() -> Layout:
    return Layout(
        np.zeros((5, 3)), ('Bx', 'By', 'Bz'), 'T', saturation=np.full(3, 6.6e-3), rate_hz=400.0
    )


@pytest.fixture
def rows() -> np.ndarray:
    """Distinct readings (T) that float32 microtesla hold to 1e-7."""
    return np.random.default_rng(0).integers(-2500, 2500, (64, 5, 3)) * 2.4e-6


@pytest.fixture
def port() -> Iterator[SimulatedSerialPort]:
    with SimulatedSerialPort() as twin:
        yield twin


@pytest.fixture
def board(port: SimulatedSerialPort, layout: Layout) -> Iterator[ReskinBoard]:
    with ReskinBoard(port.port, layout) as driver:
        yield driver
