# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Tactile sensors on robot hands: from the bytes of the chip to contacts and grip commands."""

from __future__ import annotations

import os
import pkgutil
from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tactile_ros.errors import TactileError
    from tactile_ros.evaluation.recording_files import save_recording
    from tactile_ros.notebook import Calibration, load, sensor
    from tactile_ros.sensors import list_sensors
    from tactile_ros.types import ContactState, ContactStates, Frame, Layout, Outline, Recording

__version__ = '0.1.0'
__all__ = [
    'Calibration', 'ContactState', 'ContactStates', 'Frame', 'Layout', 'Outline', 'Recording',
    'TactileError', 'list_sensors', 'load', 'save_recording', 'sensor',
]  # fmt: skip

# The interfaces generated from msg/ lie in the install tree under this same name: found there also
# when this source folder comes first on the path.
__path__ = pkgutil.extend_path(__path__, __name__)

_HOMES = {
    'TactileError': 'errors', 'save_recording': 'evaluation.recording_files',
    'Calibration': 'notebook', 'load': 'notebook', 'sensor': 'notebook', 'list_sensors': 'sensors',
}  # fmt: skip


def __getattr__(name: str) -> object:
    """Import a name of `__all__` when it is first asked for: the package itself loads no numpy."""
    if name not in __all__:
        msg = f'module {__name__!r} has no attribute {name!r}'
        raise AttributeError(msg)
    value: object = getattr(import_module(f'{__name__}.{_HOMES.get(name, "types")}'), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Names of the module and those that it imports when they are asked for."""
    return sorted({*globals(), *__all__})


def use_one_thread() -> None:
    """Keep BLAS on one thread unless the user said otherwise; call before numpy is loaded.

    Frames are a few dozen numbers: threads only steal time from a loop.
    """
    for name in ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'):
        os.environ.setdefault(name, '1')
