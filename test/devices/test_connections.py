"""Boards of the framed protocol: what their port cannot carry."""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import pytest

from tactile_ros.devices.connections import FramedConnection, open_framed
from tactile_ros.devices.framed_protocol import gradiometer
from tactile_ros.types import Layout


def test_a_rate_that_does_not_fit_is_refused_with_both_named() -> None:
    fast = Layout(np.zeros((4, 3)), ('Bx', 'Bz'), 'T', rate_hz=1000.0)
    slow_port = FramedConnection(baud=115_200)
    # 38 bytes of a frame 1000 times a second; ten bits for each byte
    with pytest.raises(ValueError, match=r'38000 .*11520'):
        open_framed(fast, slow_port, gradiometer(), 1e-6, time.monotonic_ns)
    usb = dataclasses.replace(slow_port, native_usb=True)
    open_framed(fast, usb, gradiometer(), 1e-6, time.monotonic_ns)
