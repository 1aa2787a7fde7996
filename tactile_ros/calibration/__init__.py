"""Calibrations: trees of fitted objects <-> one .npz of plain arrays with a schema version.

Nothing is ever pickled, and a file is parsed as hostile.
"""

from __future__ import annotations

from tactile_ros.calibration.archive import MOST_BYTES, MOST_MEMBERS, SCHEMA, read, write
from tactile_ros.calibration.tree import Arrays, digest, flatten, restore

__all__ = [
    'MOST_BYTES',
    'MOST_MEMBERS',
    'SCHEMA',
    'Arrays',
    'digest',
    'flatten',
    'read',
    'restore',
    'write',
]
