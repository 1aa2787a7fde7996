# Copyright 2026 The tactile_ros authors. SPDX-License-Identifier: Apache-2.0
"""Failures of the world, as opposed to wrong arguments (those are ValueErrors).

TactileError
 +-- DeviceError           a port or chip does not do what its datasheet says
 |    +-- DeviceTimeout    nothing came in time
 |    +-- NotAcknowledged  a chip on a bus does not answer to its address
 +-- NotCalibratedError    an estimate was asked for before a fit or a calibration
 +-- CalibrationError      a calibration file is damaged, foreign or of another version
 +-- RecordingError        a recording or bag cannot be read as one
 +-- MissingPackageError   an optional package is needed for what was asked
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType


class TactileError(Exception):
    """Root of the tree: everything that this package raises on purpose besides ValueError."""


class DeviceError(TactileError):
    """A device failed: port missing or busy, unplugged, answers that make no sense."""


class DeviceTimeout(DeviceError):
    """Nothing came from the device within the time that was given."""


class NotAcknowledged(DeviceError):
    """A chip on a bus does not answer to its address."""


class NotCalibratedError(TactileError):
    """An estimator was asked to predict before it was fitted."""


class CalibrationError(TactileError):
    """A calibration file is damaged, hostile, of another sensor, version or shape."""


class RecordingError(TactileError):
    """A recording or bag is damaged or foreign beyond what could be read."""


class MissingPackageError(TactileError):
    """An optional package is not installed; the sentence says how to install it."""


def load_package(name: str, need: str, package: str = '') -> ModuleType:
    """Import an optional module; MissingPackageError says who needs it and what pip installs."""
    try:
        return import_module(name)
    except ImportError as error:
        msg = f'{need}: pip install {package or name.partition(".")[0]}'
        raise MissingPackageError(msg) from error


def plain(text: str) -> str:
    """Text whose control characters, such as those that colour a terminal, are spelled out."""
    return ''.join(c if c.isprintable() or c in '\n\t' else repr(c)[1:-1] for c in text)
